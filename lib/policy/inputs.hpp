// InputColumns: the observations that a network reads, and where they lie in rows of all of them.
#pragma once

#include <cstdint>
#include <string>

#include "core/error.hpp"
#include "policy/config.hpp"
#include "sim/row_layout.hpp"

namespace giga {

/// Columns [first, first + size) of rows of `row` numbers, where the observations `set` lie.
struct InputColumns {
  int64_t row = 0, first = 0, size = 0;
  ObservationSet set = ObservationSet::all();

  InputColumns() = default;
  /// All of a row.
  InputColumns(int64_t whole_row) : row(whole_row), size(whole_row) {}
  InputColumns(int64_t row_, int64_t first_, int64_t size_, ObservationSet set_ = ObservationSet::all())
      : row(row_), first(first_), size(size_), set(set_) {}

  bool all() const { return size == row; }
  /// Rows of several observations are flat.
  ObservationShape shape() const { return static_cast<int>(size); }
};

/// Throws InputError where agents are given images alone, which no network here reads yet.
inline void check_has_numbers(const SimSpec& spec, const std::string& who) {
  if (spec.params.images_only)
    throw InputError(cat(who, " reads numbers, and agents of '", spec.name,
                         "' are given images alone (observation.type: rgb); rgb_vector gives both"));
}

/// The columns in rows of all observations of a scenario; `egocentric` needs SimParams::egocentric_view.
inline InputColumns input_columns(NetworkInputs inputs, const SimSpec& spec) {
  check_has_numbers(spec, "the network");
  const RowLayout rows = observation_rows(spec);
  const ObservationSet set = inputs == NetworkInputs::all ? rows.set() : Observation::egocentric;
  GIGA_CHECK((rows.set() & set) == set, "no egocentric view in '", spec.name, "'");
  const RowLayout::Columns columns = rows.columns(set);
  return {rows.stride(), columns.first, columns.count, set};
}

}  // namespace giga
