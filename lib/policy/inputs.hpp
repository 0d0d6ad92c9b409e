// InputColumns: the observations that a network reads, and where they lie in rows of all of them.
#pragma once

#include <cstdint>
#include <string>

#include "core/error.hpp"
#include "policy/config.hpp"
#include "sim/image_rows.hpp"
#include "sim/row_layout.hpp"
#include "sim/spec.hpp"

namespace giga {

/// Columns [first, first + size) of rows of `row` numbers, where the observations `set` lie; or an image, which is a
/// row of bytes of its own and read as a whole.
struct InputColumns {
  int64_t row = 0, first = 0, size = 0;
  ObservationSet set = all_numbers();
  int side = 0;  ///< pixels of a side of the image; 0: numbers are read

  InputColumns() = default;
  /// All of a row.
  InputColumns(int64_t whole_row) : row(whole_row), size(whole_row) {}
  InputColumns(int64_t row_, int64_t first_, int64_t size_, ObservationSet set_ = all_numbers())
      : row(row_), first(first_), size(size_), set(set_) {}
  static InputColumns image_of(int side) {
    InputColumns image(image_bytes(side));
    image.set = Observation::image;
    image.side = side;
    return image;
  }

  bool all() const { return size == row; }
  bool is_image() const { return side > 0; }
  /// Rows of several observations are flat.
  ObservationShape shape() const {
    return is_image() ? ObservationShape(side, side, kChannels) : ObservationShape(static_cast<int>(size));
  }
};

/// Throws InputError where agents are given images alone.
inline void check_has_numbers(const SimSpec& spec, const std::string& who) {
  if (spec.params.images_only)
    throw InputError(cat(who, " reads numbers, and agents of '", spec.name,
                         "' are given images alone (observation.type: rgb); rgb_vector gives both"));
}

/// The columns in rows of all numbers of a scenario; `egocentric` needs SimParams::egocentric_view.
inline InputColumns input_columns(NetworkInputs inputs, const SimSpec& spec) {
  check_has_numbers(spec, "the network");
  const RowLayout rows = observation_rows(spec);
  const ObservationSet set = inputs == NetworkInputs::all ? rows.set() : Observation::egocentric;
  GIGA_CHECK((rows.set() & set) == set, "no egocentric view in '", spec.name, "'");
  const RowLayout::Columns columns = rows.columns(set);
  return {rows.stride(), columns.first, columns.count, set};
}

/// What a network reads in a scenario: the image of an agent, or columns of its numbers.
inline InputColumns inputs_of(const NetworkConfig& config, const SimSpec& spec) {
  if (!config.reads_image()) return input_columns(config.inputs, spec);
  if (spec.params.resolution == 0)
    throw InputError(
        cat("the network reads images, and agents of '", spec.name, "' are given none (observation.type: vector)"));
  return InputColumns::image_of(spec.params.resolution);
}

}  // namespace giga
