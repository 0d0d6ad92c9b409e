// Plots of many points for a page: as wide as their place, in the colours of its style sheet. Its script moves what is
// there: it zooms, smooths, and reads the values out (lib/report/chart.js).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "chart/markup.hpp"

namespace giga {

/// A line with a band around it where `low` and `high` have values. NaN = no value, which the line bridges.
struct PlotCurve {
  std::string style;  ///< CSS properties that colour it
  const std::vector<double>& x;
  const std::vector<double>& mean;
  const std::vector<double>&low, &high;
};

struct CurvePlot {
  std::string description;  ///< what a screen reader says
  std::pair<double, double> x_range;
  std::optional<std::pair<double, double>> y_range;  ///< nothing: as the values ask for
  std::vector<PlotCurve> curves;
};

/// Writes an SVG element into a page of HTML. A curve is an element of class `line` with paths of class `curve`, `band`
/// and, where it has few points, `dots`; their coordinates are whole shares of the plot, to 1e-6. The attributes
/// `data-low` and `data-high` say which values the lower and the upper edge are; `data-rows` of a line with unknown
/// values, which points of its x are known.
void draw_curve_plot(Markup& page, const CurvePlot& plot);

}  // namespace giga
