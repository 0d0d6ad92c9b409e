// Plots of curves, and what all drawings share. Whole pictures: tests/rating/pictures_test.cpp.
#include <gtest/gtest.h>

#include <limits>

#include "chart/curve_plot.hpp"
#include "chart/heat_map.hpp"
#include "chart/line_chart.hpp"
#include "chart/markup.hpp"
#include "core/error.hpp"
#include "support/xml.hpp"

namespace giga::test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
using Elements = std::vector<XmlElement>;
using Texts = std::vector<std::string>;

/// An attribute of all elements of a class.
Texts all_of(const Elements& elements, const std::string& of_class, const std::string& attribute) {
  Texts values;
  for (const XmlElement& e : elements)
    if (e.attributes.contains("class") && e.attributes.at("class") == of_class)
      values.push_back(e.attributes.contains(attribute) ? e.attributes.at(attribute) : "");
  return values;
}

Elements elements_of(const CurvePlot& plot) {
  Markup page;
  draw_curve_plot(page, plot);
  return parse_xml(page.str());
}

const std::vector<double> kX = {0, 100, 400}, kNone;

// Left and top are 0, right and bottom a million.
TEST(CurvePlot, PointsStandWhereTheirValuesAre) {
  const std::vector<double> mean = {0, 2, 1}, low = {0, 1, 0}, high = {0, 4, 2};
  const Elements svg = elements_of({"", {0, 400}, {}, {{"a: b", kX, mean, low, high}}});
  // 0 to 4 with 4 % of 4 at both ends: -0.16 to 4.16, in which 0 is at 4.16 / 4.32 = 0.962963.
  EXPECT_EQ(svg[0].attributes.at("class"), "plot");
  EXPECT_DOUBLE_EQ(std::stod(svg[0].attributes.at("data-low")), -0.16);
  EXPECT_DOUBLE_EQ(std::stod(svg[0].attributes.at("data-high")), 4.16);
  EXPECT_EQ(all_of(svg, "curve", "d"), Texts{"M0 962963 250000 500000 1000000 731481"});
  EXPECT_EQ(all_of(svg, "band", "d"),
            Texts{"M0 962963 250000 37037 1000000 500000 1000000 962963 250000 731481 0 962963"});
  EXPECT_EQ(all_of(svg, "dots", "d"), Texts{"M0 962963h0M250000 500000h0M1000000 731481h0"});
  EXPECT_EQ(all_of(svg, "line", "style"), Texts{"a: b"});
}

TEST(CurvePlot, UnknownValuesAreBridgedAndTold) {
  const std::vector<double> mean = {0.5, kNan, 1};
  const Elements svg = elements_of({"", {0, 400}, {{0, 1}}, {{"", kX, mean, kNone, kNone}}});
  EXPECT_EQ(all_of(svg, "curve", "d"), Texts{"M0 500000 1000000 19231"});  // 0.02 / 1.04 below the upper edge
  EXPECT_EQ(all_of(svg, "line", "data-rows"), Texts{"0 2"});
  EXPECT_EQ(all_of(svg, "band", "d"), Texts());
}

TEST(CurvePlot, AxesHaveRoundLabels) {
  const std::vector<double> x = {0, 120'000}, mean = {-1, 1.5};
  const Elements svg = elements_of({"", {0, 120'000}, {}, {{"", x, mean, kNone, kNone}}});
  Texts labels;
  for (const XmlElement& e : svg)
    if (e.name == "text") labels.push_back(e.text);
  EXPECT_EQ(labels, (Texts{"-1", "-0.5", "0", "0.5", "1", "1.5", "0", "20k", "40k", "60k", "80k", "100k", "120k"}));
  EXPECT_EQ(all_of(svg, "x", "x"), (Texts{"0%", "16.67%", "33.33%", "50%", "66.67%", "83.33%", "100%"}));
}

TEST(CurvePlot, OnePointAndConstantsAreDrawn) {
  const std::vector<double> x = {7}, mean = {0};
  const Elements svg = elements_of({"", {7, 7}, {}, {{"", x, mean, kNone, kNone}}});
  EXPECT_EQ(all_of(svg, "curve", "d"), Texts{"M500000 500000"});
}

TEST(CurvePlot, WhatIsInfiniteIsLeftOut) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<double> mean = {1, kInfinity, 1}, nowhere(3, kInfinity);
  EXPECT_EQ(all_of(elements_of({"", {0, 400}, {}, {{"", kX, mean, kNone, kNone}}}), "curve", "d"),
            Texts{"M0 500000 1000000 500000"});
  EXPECT_EQ(all_of(elements_of({"", {0, 400}, {}, {{"", kX, nowhere, kNone, kNone}}}), "curve", "d"), Texts());
}

TEST(CurvePlot, ManyPointsHaveNoDots) {
  const std::vector<double> x(41, 1.0), mean(41, 2.0);
  EXPECT_EQ(all_of(elements_of({"", {0, 1}, {}, {{"", x, mean, kNone, kNone}}}), "dots", "d"), Texts());
}

TEST(Chart, TicksAreRound) {
  using Ticks = std::vector<double>;
  EXPECT_EQ(axis_ticks(-63, 556, 5), (Ticks{-100, 0, 100, 200, 300, 400, 500, 600}));
  EXPECT_EQ(axis_ticks(0, 1, 5), (Ticks{0, 0.2, 0.4, 0.2 * 3, 0.8, 1}));
  EXPECT_EQ(axis_ticks(0, 82, 4), (Ticks{0, 20, 40, 60, 80, 100}));
}

TEST(Chart, ColoursOfShares) {
  EXPECT_EQ(share_colour(0), "#c44e00");
  EXPECT_EQ(share_colour(0.5), "#f8f8f7");
  EXPECT_EQ(share_colour(1), "#0060a0");
}

TEST(Chart, NumbersInSvgAreShort) {
  EXPECT_EQ(svg_number(12.5), "12.5");
  EXPECT_EQ(svg_number(100), "100");
  EXPECT_EQ(svg_number(1.0 / 3), "0.33");
  EXPECT_EQ(svg_number(-0.001), "0");
}

TEST(Chart, TheReaderOfXmlIsStrict) {
  EXPECT_NO_THROW(parse_xml("<a b=\"&lt;\"><c/>x</a>\n"));
  for (const char* bad : {"<a>", "<a></b>", "<a b=c/>", "<a b=\"&\"/>", "<a b=\"1\" b=\"2\"/>", "<a>&</a>", "<a/><b/>"})
    EXPECT_THROW(parse_xml(bad), Error) << bad;
}

}  // namespace
}  // namespace giga::test
