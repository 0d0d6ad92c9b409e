// RowView: the egocentric view as a function of the vector observation, so that a policy which reads the view can be
// used by whoever has the original's row of numbers and nothing of ours.
#pragma once

#include <optional>

#include "export/array_code.hpp"
#include "sim/spec.hpp"

namespace giga {

/// What the function depends on besides the row. The whole of the view follows from the row (the row tells the kinds of
/// agents as sprites), but for rounding: a row holds shares of the map in fp32, so the place of another agent is known
/// to some 1e-7 of the map's side, and its bearing to that over its distance.
struct RowView {
  int neighbors = 0;               ///< agents that a row tells of, without the observer
  bool waypoint = false;           ///< 5 numbers of the row
  int boxes = 0, box_numbers = 4;  ///< obstacles of the row; 6 numbers each where they have heights
  float limit_x = 10, limit_y = 10;
  int opponents = 0, team_mates = 0;  ///< that the view tells of, at most
  bool kinds = false;                 ///< the view tells kinds

  /// Numbers of the row, of the view, and where the view begins behind the row in memory: at a multiple of 8.
  int row_size() const;
  int view_size() const;
  int view_at() const { return (row_size() + 7) / 8 * 8; }
  int size() const { return view_at() + view_size(); }
  bool operator==(const RowView&) const = default;
};

/// That of a scenario; none where it offers no egocentric view.
std::optional<RowView> row_view(const SimSpec& spec);

/// Row [B, row_size()] -> what a scenario writes side by side [B, size()]: the row, zeros, the view.
Array with_view(const RowView& view, const Array& row);

}  // namespace giga
