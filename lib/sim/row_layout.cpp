#include "sim/row_layout.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "sim/observations.hpp"

namespace giga {

RowLayout::RowLayout(const SimParams& p, ObservationSet set) : set_(set) {
  constexpr int kStep = 8;
  for_each_observation([&](auto kind) {
    using Kind = decltype(kind);
    if (!set.has(Kind::id)) return;
    GIGA_CHECK(Kind::of == ObservationOf::agent && Kind::offered(p), "no observation '", Kind::name,
               "' of the agents of this scenario");
    GIGA_CHECK(Kind::type == ElementType::f32, "observation '", Kind::name,
               "' is not made of floats, and rows of several observations are: it needs a buffer of its own");
    const auto k = static_cast<int>(Kind::id);
    first_[k] = stride_;
    numbers_ = first_[k] + Kind::shape(p).size();
    end_[k] = stride_ = (numbers_ + kStep - 1) / kStep * kStep;
  });
}

RowLayout::Columns RowLayout::columns(ObservationSet reads) const {
  int64_t first = stride_, end = 0;
  for (int k = 0; k < kNObservations; ++k) {
    if (!reads.has(static_cast<Observation>(k))) continue;
    GIGA_CHECK(set_.has(static_cast<Observation>(k)), "observation ", k, " is not in these rows");
    first = std::min<int64_t>(first, first_[k]);
    end = std::max<int64_t>(end, end_[k]);
  }
  for (int k = 0; k < kNObservations; ++k)
    GIGA_CHECK(!set_.has(static_cast<Observation>(k)) || reads.has(static_cast<Observation>(k)) || end_[k] <= first ||
                   first_[k] >= end,
               "observation ", k, " lies between those that are read: they are not one range of columns");
  return {first, std::max<int64_t>(end - first, 0)};
}

void RowLayout::attach(TeamIo& team, ObservationSet wanted, float* rows, float* final_rows) const {
  for (int k = 0; k < kNObservations; ++k) {
    const auto kind = static_cast<Observation>(k);
    if (!(set_ & wanted).has(kind)) continue;
    team.obs[kind] = {rows ? rows + first_[k] : nullptr, final_rows ? final_rows + first_[k] : nullptr, stride_,
                      end_[k] - first_[k]};
  }
}

}  // namespace giga
