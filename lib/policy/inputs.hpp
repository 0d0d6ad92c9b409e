// InputColumns: the numbers of an observation that a network reads.
#pragma once

#include <cstdint>

#include "core/error.hpp"
#include "policy/config.hpp"
#include "sim/observe.hpp"

namespace giga {

/// Columns [first, first + size) of rows of `row` numbers.
struct InputColumns {
  int64_t row = 0, first = 0, size = 0;

  InputColumns() = default;
  /// All of a row.
  InputColumns(int64_t whole_row) : row(whole_row), size(whole_row) {}
  InputColumns(int64_t row_, int64_t first_, int64_t size_) : row(row_), first(first_), size(size_) {}

  bool all() const { return size == row; }
};

/// The columns in the padded observations of a scenario; `body` needs SimParams::body_view.
inline InputColumns input_columns(NetworkInputs inputs, const SimSpec& spec) {
  const int64_t row = spec.padded_observation_size();
  if (inputs == NetworkInputs::all) return row;
  GIGA_CHECK(spec.params.body_view, "no body view in '", spec.name, "'");
  const int64_t first = body_at(spec.params);
  return {row, first, row - first};
}

}  // namespace giga
