// Drawing of heat maps.
#include "chart/heat_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "chart/markup.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

constexpr const char* kEmpty = "#eef0f3";
constexpr double kAxisLabel = 22, kLabelGap = 8;
constexpr double kBlockGap = 6, kScaleGap = 34, kScaleWidth = 14, kScaleText = 44;
constexpr double kNarrowestHeading = 480;  // room for title and subtitle over a small matrix

struct Colour {
  double red, green, blue;
};
// From orange over white to blue, about equally steep in lightness on both sides.
constexpr std::array<Colour, 5> kStops = {Colour{196, 78, 0}, Colour{245, 176, 116}, Colour{248, 248, 247},
                                          Colour{126, 182, 221}, Colour{0, 96, 160}};

Colour colour_of(double share) {
  const double at = std::clamp(share, 0.0, 1.0) * (kStops.size() - 1);
  const size_t k = std::min(static_cast<size_t>(at), kStops.size() - 2);
  const double t = at - static_cast<double>(k);
  const auto mix = [&](double a, double b) { return a + t * (b - a); };
  const Colour &a = kStops[k], &b = kStops[k + 1];
  return {mix(a.red, b.red), mix(a.green, b.green), mix(a.blue, b.blue)};
}

/// Dark on light, white on dark.
const char* text_colour(double share) {
  const Colour c = colour_of(share);
  return 0.299 * c.red + 0.587 * c.green + 0.114 * c.blue < 135 ? "#ffffff" : kInk;
}

/// Where everything is; the cells shrink as the matrix grows.
struct Layout {
  explicit Layout(const HeatMap& map) {
    const size_t n = std::max(map.rows.size(), map.columns.size());
    cell = n <= 8 ? 54 : n <= 14 ? 44 : n <= 24 ? 34 : 26;
    text = n <= 8 ? 14 : n <= 14 ? 13 : n <= 24 ? 11 : 9;
    label = std::min(text + 0.5, 12.5);
    for (const std::string& name : map.rows) row_names = std::max(row_names, text_width(name, label));
    for (const std::string& name : map.columns) column_names = std::max(column_names, text_width(name, label));
    upright = column_names > cell - 4;
    if (!upright) column_names = label;
    left = kMargin + kAxisLabel + row_names + kLabelGap;
    top = kHeadingHeight + kAxisLabel + column_names + kLabelGap;
    for (size_t k = 0; k <= n; ++k) {
      const auto gaps = std::count_if(map.blocks.begin(), map.blocks.end(), [k](size_t b) { return b <= k; });
      offset.push_back(cell * static_cast<double>(k) + kBlockGap * static_cast<double>(gaps));
    }
    right = left + offset[map.columns.size()];
    bottom = top + offset[map.rows.size()];
    width = std::max(right + kScaleGap + kScaleWidth + kScaleText + kMargin,
                     std::max({kNarrowestHeading, text_width(map.subtitle, kTextSize) + 2 * kMargin,
                               text_width(map.title, kTitleSize) + 2 * kMargin}));
    height = bottom + kMargin + 8;
  }
  /// Upper edges of rows, relative to `top`; also left ones of columns.
  std::vector<double> offset;
  double cell, text, label, row_names = 0, column_names = 0;
  bool upright;  // names of columns run upwards
  double left, top, right, bottom, width, height;
};

void draw_names(Markup& svg, const HeatMap& map, const Layout& at) {
  for (size_t i = 0; i < map.rows.size(); ++i)
    svg.text(map.rows[i], {{"x", at.left - kLabelGap},
                           {"y", at.top + at.offset[i] + at.cell / 2 + at.label * 0.36},
                           {"text-anchor", "end"},
                           {"font-size", at.label},
                           {"fill", kInk}});
  for (size_t j = 0; j < map.columns.size(); ++j) {
    const double x = at.left + at.offset[j] + at.cell / 2 + (at.upright ? at.label * 0.36 : 0);
    const std::string place = cat("translate(", svg_number(x), " ", svg_number(at.top - kLabelGap), ")");
    svg.text(map.columns[j], {{"transform", at.upright ? place + " rotate(-90)" : place},
                              {"text-anchor", at.upright ? "start" : "middle"},
                              {"font-size", at.label},
                              {"fill", kInk}});
  }
  svg.text(map.column_label, {{"x", (at.left + at.right) / 2},
                              {"y", kHeadingHeight + 8},
                              {"text-anchor", "middle"},
                              {"font-size", kTextSize},
                              {"fill", kQuiet}});
  svg.text(map.row_label, {{"transform", cat("translate(", svg_number(kMargin + 10), " ",
                                             svg_number((at.top + at.bottom) / 2), ") rotate(-90)")},
                           {"text-anchor", "middle"},
                           {"font-size", kTextSize},
                           {"fill", kQuiet}});
}

void draw_cells(Markup& svg, const HeatMap& map, const Layout& at) {
  const size_t n_columns = map.columns.size();
  for (size_t i = 0; i < map.rows.size(); ++i) {
    for (size_t j = 0; j < n_columns; ++j) {
      const double value = map.values[i * n_columns + j];
      const double x = at.left + at.offset[j], y = at.top + at.offset[i];
      svg.hint(map.hints[i * n_columns + j]);
      svg.add("rect", {{"x", x + 0.5},
                       {"y", y + 0.5},
                       {"width", at.cell - 1},
                       {"height", at.cell - 1},
                       {"rx", 2.0},
                       {"fill", std::isnan(value) ? kEmpty : share_colour(value)}});
      if (std::isnan(value)) continue;
      svg.text(std::to_string(std::lround(100 * value)), {{"x", x + at.cell / 2},
                                                          {"y", y + at.cell / 2 + at.text * 0.36},
                                                          {"text-anchor", "middle"},
                                                          {"font-size", at.text},
                                                          {"fill", text_colour(value)},
                                                          {"pointer-events", "none"}});
    }
  }
}

void draw_scale(Markup& svg, const HeatMap& map, const Layout& at) {
  constexpr int kSteps = 40;
  const double x = at.right + kScaleGap, tall = std::min(at.bottom - at.top, 240.0), step = tall / kSteps;
  for (int k = 0; k < kSteps; ++k)
    svg.add("rect", {{"x", x},
                     {"y", at.top + k * step},
                     {"width", kScaleWidth},
                     {"height", step + 0.5},
                     {"fill", share_colour(1 - (k + 0.5) / kSteps)}});
  for (const int percent : {0, 50, 100})
    svg.text(cat(percent, " %"), {{"x", x + kScaleWidth + 6},
                                  {"y", at.top + (100 - percent) / 100.0 * (tall - 9) + 9},
                                  {"font-size", 11.5},
                                  {"fill", kQuiet}});
  svg.text(map.scale_label,
           {{"transform", cat("translate(", svg_number(x - 6), " ", svg_number(at.top + tall / 2), ") rotate(-90)")},
            {"text-anchor", "middle"},
            {"font-size", 11.5},
            {"fill", kQuiet}});
}

void draw_picture(Markup& svg, const HeatMap& map, const Layout& at) {
  const auto picture = open_picture(svg, at.width, at.height, map.title + ". " + map.subtitle);
  svg.text(map.title, {{"x", kMargin}, {"y", 32.0}, {"font-size", kTitleSize}, {"font-weight", "600"}, {"fill", kInk}});
  svg.text(map.subtitle, {{"x", kMargin}, {"y", 52.0}, {"font-size", kTextSize}, {"fill", kQuiet}});
  draw_names(svg, map, at);
  draw_cells(svg, map, at);
  draw_scale(svg, map, at);
}

}  // namespace

std::string share_colour(double share) {
  const Colour c = colour_of(share);
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", static_cast<unsigned>(std::lround(c.red)) & 0xffu,
                static_cast<unsigned>(std::lround(c.green)) & 0xffu,
                static_cast<unsigned>(std::lround(c.blue)) & 0xffu);
  return text;
}

std::string draw_heat_map(const HeatMap& map) {
  GIGA_CHECK(map.values.size() == map.rows.size() * map.columns.size() && map.hints.size() == map.values.size(),
             map.values.size(), " values and ", map.hints.size(), " hints of ", map.rows.size(), " x ",
             map.columns.size());
  const Layout at(map);
  Markup svg;
  draw_picture(svg, map, at);
  return svg.str();
}

}  // namespace giga
