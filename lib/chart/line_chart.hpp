// Line charts with error bars, several panels of the same size side by side, as SVG.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace giga {

struct ChartPoint {
  double x = 0;
  double y = 0;  ///< +inf, -inf: a triangle at the upper or lower edge
  double low = 0, high = 0;
  bool ringed = false;
  std::string hint;  ///< shown while the pointer rests on it
};

struct ChartLine {
  std::string label;  ///< for the legend; lines of the same label have the same looks
  int colour = 0;     ///< index into a palette that colour-blind people can tell apart
  bool dashed = false;
  std::vector<ChartPoint> points;
};

/// A horizontal line across a panel with its name at the right, and a band around it.
struct LevelLine {
  std::string label;
  double y = 0, low = 0, high = 0;
};

struct ChartPanel {
  std::string title;
  std::vector<ChartLine> lines;
  std::vector<LevelLine> levels;
};

/// Units in which an axis can be labelled, as the values ask for: thousands, millions and billions of what is counted;
/// seconds, minutes and hours.
enum class AxisUnit : uint8_t { count, seconds };

struct LineChart {
  std::string title, subtitle;
  std::string x_label, y_label;
  AxisUnit x_unit = AxisUnit::count;
  std::string ring_label;                            ///< what a ring around a point means
  std::string beyond_label;                          ///< what a triangle means
  std::optional<std::pair<double, double>> y_range;  ///< nothing: as the values ask for
  bool y_percent = false;                            ///< shares, drawn as percent
  std::vector<ChartPanel> panels;
};

/// The picture; at least one panel.
std::string draw_line_chart(const LineChart& chart);

/// Colours of lines, by index modulo their number (Okabe and Ito 2008; the first two are those of the teams).
const char* line_colour(int index);

/// Round numbers at equal distances that cover [low, high], about `count` of them.
std::vector<double> axis_ticks(double low, double high, int count);

}  // namespace giga
