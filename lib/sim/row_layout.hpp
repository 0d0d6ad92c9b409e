// RowLayout: several observations of an agent side by side in one row of memory.
#pragma once

#include "sim/spec.hpp"
#include "sim/world.hpp"

namespace giga {

/// Each observation begins at a multiple of 8 numbers (32 bytes), so that it can be read alone and fast; rows end at
/// one too. What lies between is zero: whoever makes the rows fills them so, and a step writes nothing else there. All
/// are floats: an observation of another type, such as an image of bytes, needs a buffer of its own (ObservationIo has
/// one for each).
class RowLayout {
 public:
  RowLayout() = default;
  /// `set`: observations of agents that the scenario offers, in the order of the enumeration.
  RowLayout(const SimParams& p, ObservationSet set);

  struct Columns {
    int64_t first = 0, count = 0;
    bool operator==(const Columns&) const = default;
  };
  /// Where the observations of `reads` lie: from the first of them to the end of the last, zeros behind it included.
  /// All of them must be part of the row, and no other may lie between them.
  Columns columns(ObservationSet reads) const;

  ObservationSet set() const { return set_; }
  int stride() const { return stride_; }    ///< numbers from one row to the next
  int numbers() const { return numbers_; }  ///< the same without the zeros behind the last observation

  /// Lets a step write those of `wanted` that are part of the row to rows [W, n, stride]; `final_rows` may be null.
  void attach(TeamIo& team, ObservationSet wanted, float* rows, float* final_rows = nullptr) const;

 private:
  ObservationSet set_;
  int first_[kNObservations] = {}, end_[kNObservations] = {};  // end: with the zeros behind
  int stride_ = 0, numbers_ = 0;
};

/// Whatever numbers a scenario offers its agents.
constexpr ObservationSet all_numbers() { return ObservationSet(Observation::vector) | Observation::egocentric; }

/// The row that holds all observations which a scenario offers an agent: what networks, scripts and exported policies
/// find theirs in.
inline RowLayout observation_rows(const SimSpec& spec) { return RowLayout(spec.params, spec.observations()); }

}  // namespace giga
