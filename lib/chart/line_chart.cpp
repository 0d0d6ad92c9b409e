// Drawing of line charts.
#include "chart/line_chart.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "chart/markup.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

constexpr const char *kGrid = "#e4e8ed", *kLevel = "#8a94a3";
constexpr double kSmallSize = 12;
constexpr double kYLabelWidth = 16, kAxisWidth = 52, kTickHeight = 30;
constexpr double kXLabelHeight = 26, kGap = 24, kLevelDistance = 15;
constexpr double kLineWidth = 2, kPointRadius = 3.6, kRingRadius = 6.5;
constexpr const char* kDashes = "6 4";

struct Box {
  double x, y, width, height;
  double right() const { return x + width; }
  double bottom() const { return y + height; }
};

struct Range {
  double low, high;
};

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

/// A unit in which the largest of some numbers is easy to read.
struct Unit {
  double size;
  const char* name;
};
Unit unit_for(double largest, AxisUnit kind) {
  if (kind == AxisUnit::seconds)
    return largest >= 7200 ? Unit{3600, "hours"} : largest >= 120 ? Unit{60, "minutes"} : Unit{1, "seconds"};
  for (const Unit unit : {Unit{1e9, "billions"}, Unit{1e6, "millions"}, Unit{1e3, "thousands"}})
    if (largest >= unit.size) return unit;
  return {1, ""};
}

/// A triangle whose tip is at (x, y) and shows up (1) or down (-1).
std::string triangle(double x, double y, int up) {
  const double base = y + 10 * up;
  return cat("M", svg_number(x), " ", svg_number(y), " L", svg_number(x - 6), " ", svg_number(base), " L",
             svg_number(x + 6), " ", svg_number(base), " Z");
}

/// An entry of the legend: a line's label, or what a mark means.
struct LegendEntry {
  enum class Kind { line, ring, beyond };
  Kind kind;
  std::string label;
  const ChartLine* line;  // of Kind::line
  double x = 0;
  int row = 0;
};

constexpr double kLegendSample = 34, kLegendRow = 22;

class Painter {
 public:
  explicit Painter(const LineChart& chart);
  std::string draw() const;

 private:
  void find_ranges();
  void choose_sizes();
  void fill_legend();

  void draw_heading(Markup& svg) const;
  void draw_legend(Markup& svg) const;
  void draw_panel(Markup& svg, const ChartPanel& panel, const Box& box) const;
  void draw_axes(Markup& svg, const Box& box) const;
  void draw_levels(Markup& svg, const ChartPanel& panel, const Box& box) const;
  void draw_line(Markup& svg, const ChartLine& line, const Box& box) const;
  void draw_point(Markup& svg, const ChartLine& line, const ChartPoint& p, const Box& box) const;

  Box box_of(int panel) const;
  double px(const Box& box, double x) const { return box.x + (x - x_.low) / (x_.high - x_.low) * box.width; }
  double py(const Box& box, double y) const { return box.bottom() - (y - y_.low) / (y_.high - y_.low) * box.height; }
  int n_panels() const { return static_cast<int>(chart_.panels.size()); }

  const LineChart& chart_;
  Range x_{0, 1}, y_{0, 1};
  Unit x_unit_{1, ""};
  std::vector<double> x_ticks_, y_ticks_;  // those of x in units of x_unit_
  std::vector<LegendEntry> legend_;
  int columns_ = 1;
  double panel_width_ = 0, panel_height_ = 0;  // of the plot alone
  double cell_width_ = 0, cell_height_ = 0;    // with its axes and title
  double level_width_ = 0, title_height_ = 0, panels_top_ = 0, width_ = 0, height_ = 0;
};

Painter::Painter(const LineChart& chart) : chart_(chart) {
  GIGA_CHECK(!chart.panels.empty(), "a chart without panels");
  find_ranges();
  choose_sizes();
  fill_legend();
  panels_top_ = kHeadingHeight + kLegendRow * (legend_.empty() ? 0 : legend_.back().row + 1);
  const int rows = (n_panels() + columns_ - 1) / columns_;
  height_ = panels_top_ + rows * cell_height_ + kXLabelHeight + kMargin / 2;
}

void Painter::find_ranges() {
  double x_high = 0, low = 0, high = 0;
  const auto include = [&](double from, double to) {
    low = std::min(low, from);
    high = std::max(high, to);
  };
  for (const ChartPanel& panel : chart_.panels) {
    for (const LevelLine& level : panel.levels) include(level.low, level.high);
    for (const ChartLine& line : panel.lines)
      for (const ChartPoint& p : line.points) {
        x_high = std::max(x_high, p.x);
        if (std::isfinite(p.y)) include(p.low, p.high);
      }
  }
  x_ = {0, x_high > 0 ? x_high * 1.03 : 1};
  x_unit_ = unit_for(x_.high, chart_.x_unit);
  if (high == low) high = low + 1;
  y_ = chart_.y_range ? Range{chart_.y_range->first, chart_.y_range->second} : Range{low, high};
  y_ticks_ = axis_ticks(y_.low, y_.high, 5);
  if (!chart_.y_range) y_ = {y_ticks_.front(), y_ticks_.back()};
}

void Painter::choose_sizes() {
  columns_ = n_panels() == 4 ? 2 : std::min(n_panels(), 3);
  panel_width_ = columns_ == 1 ? 660 : columns_ == 2 ? 380 : 260;
  panel_height_ = columns_ == 1 ? 340 : columns_ == 2 ? 270 : 190;
  x_ticks_ = axis_ticks(0, x_.high / x_unit_.size, columns_ == 1 ? 8 : 4);
  std::erase_if(x_ticks_, [&](double tick) { return tick * x_unit_.size > x_.high; });
  for (const ChartPanel& panel : chart_.panels)
    for (const LevelLine& level : panel.levels)
      level_width_ = std::max(level_width_, text_width(level.label, kSmallSize) + 12);
  title_height_ = n_panels() > 1 || !chart_.panels.front().title.empty() ? 32 : 14;
  cell_width_ = kAxisWidth + panel_width_ + level_width_ + kGap;
  cell_height_ = title_height_ + panel_height_ + kTickHeight;
  width_ = kMargin + kYLabelWidth + columns_ * cell_width_;
}

void Painter::fill_legend() {
  bool rings = false, beyond = false;
  for (const ChartPanel& panel : chart_.panels)
    for (const ChartLine& line : panel.lines) {
      const auto same = [&](const LegendEntry& e) { return e.label == line.label; };
      if (std::none_of(legend_.begin(), legend_.end(), same))
        legend_.push_back({LegendEntry::Kind::line, line.label, &line});
      for (const ChartPoint& p : line.points) {
        rings = rings || p.ringed;
        beyond = beyond || std::isinf(p.y);
      }
    }
  if (rings) legend_.push_back({LegendEntry::Kind::ring, chart_.ring_label, nullptr});
  if (beyond) legend_.push_back({LegendEntry::Kind::beyond, chart_.beyond_label, nullptr});
  double x = kMargin;
  int row = 0;
  for (LegendEntry& entry : legend_) {
    const double wide = kLegendSample + text_width(entry.label, kTextSize) + 22;
    if (x > kMargin && x + wide > width_ - kMargin) {
      x = kMargin;
      ++row;
    }
    entry.x = x;
    entry.row = row;
    x += wide;
  }
}

Box Painter::box_of(int panel) const {
  const int row = panel / columns_, column = panel % columns_;
  return {kMargin + kYLabelWidth + column * cell_width_ + kAxisWidth, panels_top_ + row * cell_height_ + title_height_,
          panel_width_, panel_height_};
}

std::string Painter::draw() const {
  Markup svg;
  {
    const auto picture = open_picture(svg, width_, height_, chart_.title + ". " + chart_.subtitle);
    draw_heading(svg);
    draw_legend(svg);
    for (int k = 0; k < n_panels(); ++k) draw_panel(svg, chart_.panels[static_cast<size_t>(k)], box_of(k));
  }
  return svg.str();
}

void Painter::draw_heading(Markup& svg) const {
  svg.text(chart_.title,
           {{"x", kMargin}, {"y", 32.0}, {"font-size", kTitleSize}, {"font-weight", "600"}, {"fill", kInk}});
  svg.text(chart_.subtitle, {{"x", kMargin}, {"y", 52.0}, {"font-size", kTextSize}, {"fill", kQuiet}});
  svg.text(*x_unit_.name ? cat(chart_.x_label, " (", x_unit_.name, ")") : chart_.x_label,
           {{"x", kMargin + kYLabelWidth + kAxisWidth +
                      (width_ - kMargin - kYLabelWidth - kAxisWidth - level_width_ - kGap) / 2},
            {"y", height_ - kMargin / 2 - 8},
            {"text-anchor", "middle"},
            {"font-size", kTextSize},
            {"fill", kQuiet}});
  const double middle = (panels_top_ + height_ - kXLabelHeight - kTickHeight + title_height_) / 2;
  svg.text(chart_.y_label,
           {{"transform", cat("translate(", svg_number(kMargin + 8), " ", svg_number(middle), ") rotate(-90)")},
            {"text-anchor", "middle"},
            {"font-size", kTextSize},
            {"fill", kQuiet}});
}

void Painter::draw_legend(Markup& svg) const {
  for (const LegendEntry& entry : legend_) {
    const double y = kHeadingHeight + kLegendRow * entry.row + 6, middle = entry.x + kLegendSample / 2 - 4;
    if (entry.kind == LegendEntry::Kind::line) {
      const char* colour = line_colour(entry.line->colour);
      svg.add("line", {{"x1", entry.x},
                       {"x2", entry.x + kLegendSample - 8},
                       {"y1", y},
                       {"y2", y},
                       {"stroke", colour},
                       {"stroke-width", kLineWidth},
                       {"stroke-dasharray", entry.line->dashed ? kDashes : "none"}});
      svg.add("circle", {{"cx", middle}, {"cy", y}, {"r", kPointRadius}, {"fill", colour}});
    } else if (entry.kind == LegendEntry::Kind::ring) {
      svg.add(
          "circle",
          {{"cx", middle}, {"cy", y}, {"r", kRingRadius}, {"fill", "none"}, {"stroke", kInk}, {"stroke-width", 1.6}});
    } else {
      svg.add("path", {{"d", triangle(middle, y - 5, 1)}, {"fill", kQuiet}});
    }
    svg.text(entry.label, {{"x", entry.x + kLegendSample}, {"y", y + 4.5}, {"font-size", kTextSize}, {"fill", kInk}});
  }
}

void Painter::draw_panel(Markup& svg, const ChartPanel& panel, const Box& box) const {
  svg.text(panel.title,
           {{"x", box.x}, {"y", box.y - 10}, {"font-size", kTextSize + 1}, {"font-weight", "600"}, {"fill", kInk}});
  draw_axes(svg, box);
  draw_levels(svg, panel, box);
  for (const ChartLine& line : panel.lines) draw_line(svg, line, box);
}

void Painter::draw_axes(Markup& svg, const Box& box) const {
  for (const double tick : y_ticks_) {
    const double y = py(box, tick);
    svg.add("line", {{"x1", box.x}, {"x2", box.right()}, {"y1", y}, {"y2", y}, {"stroke", tick == 0 ? kLevel : kGrid}});
    svg.text(chart_.y_percent ? number_text(100 * tick) + " %" : number_text(tick),
             {{"x", box.x - 8}, {"y", y + 4}, {"text-anchor", "end"}, {"font-size", kSmallSize}, {"fill", kQuiet}});
  }
  for (const double tick : x_ticks_) {
    const double x = px(box, tick * x_unit_.size);
    svg.add("line", {{"x1", x}, {"x2", x}, {"y1", box.bottom()}, {"y2", box.bottom() + 5}, {"stroke", kLevel}});
    svg.text(
        number_text(tick),
        {{"x", x}, {"y", box.bottom() + 19}, {"text-anchor", "middle"}, {"font-size", kSmallSize}, {"fill", kQuiet}});
  }
  svg.add("line", {{"x1", box.x}, {"x2", box.right()}, {"y1", box.bottom()}, {"y2", box.bottom()}, {"stroke", kLevel}});
}

/// The labels of levels that lie close together are moved apart, from the lowest one up.
void Painter::draw_levels(Markup& svg, const ChartPanel& panel, const Box& box) const {
  std::vector<const LevelLine*> levels;
  for (const LevelLine& level : panel.levels) levels.push_back(&level);
  std::stable_sort(levels.begin(), levels.end(), [](const auto* a, const auto* b) { return a->y < b->y; });
  double label_y = box.bottom() + kLevelDistance;
  for (const LevelLine* level : levels) {
    const double y = py(box, level->y), top = py(box, level->high);
    label_y = std::min(y, label_y - kLevelDistance);
    svg.add("rect", {{"x", box.x},
                     {"y", top},
                     {"width", box.width},
                     {"height", py(box, level->low) - top},
                     {"fill", kLevel},
                     {"fill-opacity", "0.13"}});
    svg.add(
        "line",
        {{"x1", box.x}, {"x2", box.right()}, {"y1", y}, {"y2", y}, {"stroke", kLevel}, {"stroke-dasharray", "2 3"}});
    svg.add("path", {{"d", cat("M", svg_number(box.right()), " ", svg_number(y), " L", svg_number(box.right() + 8), " ",
                               svg_number(label_y))},
                     {"stroke", kLevel}});
    svg.text(level->label, {{"x", box.right() + 11}, {"y", label_y + 4}, {"font-size", kSmallSize}, {"fill", kQuiet}});
  }
}

void Painter::draw_line(Markup& svg, const ChartLine& line, const Box& box) const {
  std::string path;
  bool down = false;  // a point beyond the scale interrupts the line
  for (const ChartPoint& p : line.points) {
    if (std::isfinite(p.y)) path += cat(down ? " L" : " M", svg_number(px(box, p.x)), " ", svg_number(py(box, p.y)));
    down = std::isfinite(p.y);
  }
  if (!path.empty())
    svg.add("path", {{"d", path.substr(1)},
                     {"fill", "none"},
                     {"stroke", line_colour(line.colour)},
                     {"stroke-width", kLineWidth},
                     {"stroke-linejoin", "round"},
                     {"stroke-dasharray", line.dashed ? kDashes : "none"}});
  for (const ChartPoint& p : line.points) draw_point(svg, line, p, box);
}

void Painter::draw_point(Markup& svg, const ChartLine& line, const ChartPoint& p, const Box& box) const {
  const char* colour = line_colour(line.colour);
  const double x = px(box, p.x);
  if (!std::isfinite(p.y)) {
    svg.hint(p.hint);
    const int up = p.y > 0 ? 1 : -1;
    return svg.add("path", {{"d", triangle(x, up > 0 ? box.y - 4 : box.bottom() + 4, up)}, {"fill", colour}});
  }
  const double y = py(box, p.y), low = py(box, p.low), high = py(box, p.high);
  svg.add("path", {{"d", cat("M", svg_number(x), " ", svg_number(low), " V", svg_number(high), " M", svg_number(x - 4),
                             " ", svg_number(low), " h8 M", svg_number(x - 4), " ", svg_number(high), " h8")},
                   {"fill", "none"},
                   {"stroke", colour},
                   {"stroke-width", 1.3}});
  if (p.ringed)
    svg.add("circle",
            {{"cx", x}, {"cy", y}, {"r", kRingRadius}, {"fill", "none"}, {"stroke", kInk}, {"stroke-width", 1.6}});
  svg.hint(p.hint);
  svg.add("circle", {{"cx", x}, {"cy", y}, {"r", kPointRadius}, {"fill", colour}});
}

}  // namespace

const char* line_colour(int index) {
  static constexpr std::array kColours = {"#0072b2", "#d55e00", "#009e73", "#b8588f",
                                          "#c68a00", "#6b5b95", "#3fa0d8", "#4b5563"};
  return kColours[static_cast<size_t>(index) % kColours.size()];
}

std::vector<double> axis_ticks(double low, double high, int count) {
  GIGA_CHECK(high > low && count > 0, "ticks from ", low, " to ", high);
  const double rough = (high - low) / count, power = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0})
    if (factor * power >= rough * 0.8) step = factor * power;
  std::vector<double> ticks;
  const double first = std::floor(low / step + 1e-9), last = std::ceil(high / step - 1e-9);
  for (double k = first; k <= last; ++k) ticks.push_back(k * step + 0.0);  // no -0
  return ticks;
}

std::string draw_line_chart(const LineChart& chart) { return Painter(chart).draw(); }

}  // namespace giga
