// Heat map: a matrix of shares with their numbers, as SVG.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace giga {

struct HeatMap {
  std::string title, subtitle;
  std::string row_label, column_label;  ///< of the axes
  std::string scale_label;              ///< of the scale of colours
  std::vector<std::string> rows, columns;
  std::vector<size_t> blocks;      ///< rows and columns before which a gap is left
  std::vector<double> values;      ///< [rows, columns] 0 to 1; NaN = no value
  std::vector<std::string> hints;  ///< [rows, columns] shown while the pointer rests on a cell
};

/// Blue is 1, white 1/2, orange 0: a scale that colour-blind people can read. Numbers are percent.
std::string draw_heat_map(const HeatMap& map);

/// "#rrggbb" of a share.
std::string share_colour(double share);

}  // namespace giga
