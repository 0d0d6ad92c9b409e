// Drawing of plots for a page. Places are percents of the plot, since only the page knows how wide it is.
#include "chart/curve_plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "chart/line_chart.hpp"
#include "chart/markup.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

constexpr double kFinest = 1e6;    // the side of the square in which curves are drawn, which the page stretches
constexpr size_t kFewPoints = 40;  // up to here a curve shows its points
constexpr double kEdge = 0.04;     // of the range of values, left free above and below

using Limits = std::pair<double, double>;

Limits y_limits(const CurvePlot& plot) {
  if (plot.y_range) return {plot.y_range->first - kEdge / 2, plot.y_range->second + kEdge / 2};
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const PlotCurve& curve : plot.curves)
    for (const std::vector<double>* values : {&curve.mean, &curve.low, &curve.high})
      for (const double value : *values) {
        if (!std::isfinite(value)) continue;
        low = std::min(low, value);
        high = std::max(high, value);
      }
  if (low > high) return {0, 1};
  const double edge = high > low ? kEdge * (high - low) : std::max(std::abs(high) / 10, 1e-9);
  return {low - edge, high + edge};
}

std::string exact(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

/// 60000 = "60k".
std::string tick_label(double value) {
  static constexpr std::array kUnits = {"", "k", "M", "G", "T"};
  size_t unit = 0;
  for (; std::abs(value) >= (unit == 0 ? 1e4 : 1e3) && unit + 1 < kUnits.size(); ++unit) value /= 1e3;
  char text[32];
  std::snprintf(text, sizeof text, "%.5g%s", value, kUnits[unit]);
  return text;
}

void draw_plot_axes(Markup& svg, const Limits& x, const Limits& y) {
  const auto percent = [](double value, double from, double to) {
    return svg_number(100 * (value - from) / (to - from)) + "%";
  };
  const auto axes = svg.open("g", {{"class", "axes"}});
  for (const double tick : axis_ticks(y.first, y.second, 6)) {
    if (tick < y.first || tick > y.second) continue;
    const std::string at = percent(tick, y.second, y.first);
    svg.add("line", {{"x2", "100%"}, {"y1", at}, {"y2", at}});
    svg.text(tick_label(tick), {{"class", "y"}, {"x", "-8"}, {"y", at}});
  }
  for (const double tick : axis_ticks(x.first, x.second, 8))
    if (tick >= x.first && tick <= x.second)
      svg.text(tick_label(tick),
               {{"class", "x"}, {"x", percent(tick, x.first, x.second)}, {"y", "100%"}, {"dy", "17"}});
}

void draw_curve(Markup& svg, const PlotCurve& curve, const Limits& x, const Limits& y) {
  const auto place = [](double share) { return std::to_string(std::lround(kFinest * share)); };
  const auto point = [&](size_t k, const std::vector<double>& values) {
    return cat(place((curve.x[k] - x.first) / (x.second - x.first)), " ",
               place((y.second - values[k]) / (y.second - y.first)));
  };
  std::vector<size_t> known;
  for (size_t k = 0; k < curve.mean.size(); ++k)
    if (std::isfinite(curve.mean[k])) known.push_back(k);
  if (known.empty()) return;

  std::string rows, line, band, dots;
  for (const size_t k : known) {
    rows += (rows.empty() ? "" : " ") + std::to_string(k);
    line += (line.empty() ? "M" : " ") + point(k, curve.mean);
    dots += "M" + point(k, curve.mean) + "h0";
    if (!curve.high.empty()) band += (band.empty() ? "M" : " ") + point(k, curve.high);
  }
  if (!curve.low.empty())
    for (auto k = known.rbegin(); k != known.rend(); ++k) band += " " + point(*k, curve.low);

  const std::string known_rows = known.size() < curve.mean.size() ? rows : "";
  const auto group = svg.open("g", {{"class", "line"}, {"style", curve.style}, {"data-rows", known_rows}});
  if (!band.empty()) svg.add("path", {{"class", "band"}, {"d", band}});
  svg.add("path", {{"class", "curve"}, {"d", line}});
  if (known.size() <= kFewPoints) svg.add("path", {{"class", "dots"}, {"d", dots}});
}

}  // namespace

void draw_curve_plot(Markup& page, const CurvePlot& plot) {
  Limits x = plot.x_range;
  if (x.first == x.second) x = {x.first - 1, x.second + 1};
  const Limits y = y_limits(plot);
  const auto svg = page.open("svg", {{"class", "plot"},
                                     {"role", "img"},
                                     {"aria-label", plot.description},
                                     {"data-low", exact(y.first)},
                                     {"data-high", exact(y.second)}});
  draw_plot_axes(page, x, y);
  {
    const std::string side = svg_number(kFinest);
    const auto curves = page.open("svg", {{"class", "curves"},
                                          {"viewBox", cat("0 0 ", side, " ", side)},
                                          {"preserveAspectRatio", "none"},
                                          {"width", "100%"},
                                          {"height", "100%"}});
    for (const PlotCurve& curve : plot.curves) draw_curve(page, curve, x, y);
  }
  page.add("rect", {{"class", "selection"}, {"width", "0"}, {"height", "100%"}});
  page.add("line", {{"class", "hairline"}, {"y2", "100%"}, {"visibility", "hidden"}});
}

}  // namespace giga
