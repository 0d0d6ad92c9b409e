// SearchCrew: a warp, or half of one, as the crew of an agent (sim/crew.hpp), whose members read, ask and rank side by
// side (sim/grid_nearest_by_crew.hpp). Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "cuda/crew_lanes.hpp"
#include "sim/grid_nearest_by_crew.hpp"

namespace giga {

/// Sync: wait_for_warp() and any_of_warp(flag) of the warp.
template <int kLanes, class Sync>
class SearchCrew : public CrewLanes<kLanes, Sync> {
  static_assert(kLanes == kWarp || kLanes == kWarp / 2);
  using Lanes = CrewLanes<kLanes, Sync>;

  /// Of a warp, in shared memory.
  struct Words {
    CrewSearch<kLanes> search[kWarp / kLanes];
    uint32_t said[kWarp];  // where there are no shuffles
  };

 public:
  static constexpr bool kRanksTogether = true;
  static constexpr int kWords = sizeof(Words) / sizeof(uint32_t);  ///< of a warp

  /// `words`: [kStageNumbers] of the warp, at least kWords.
  GIGA_HD SearchCrew(Sync sync, int lane, void* words)
      : Lanes(sync, lane, static_cast<Words*>(words)->said), words_(*static_cast<Words*>(words)) {}

  GIGA_HD CrewSearch<kLanes>& search() const { return words_.search[Lanes::lane_ / kLanes]; }
  /// Instead of the search: what members put together of a row.
  GIGA_HD float* stage() const { return crew_stage<kLanes>(&words_, Lanes::lane_); }
  /// Of the members up to this one.
  GIGA_HD int32_t sum_up_to(int32_t value) const {
    const int index = Lanes::index();
#if defined(__CUDA_ARCH__)
    GIGA_UNROLL
    for (int apart = 1; apart < kLanes; apart *= 2) {
      const int32_t other = __shfl_up_sync(~0u, value, apart, kLanes);
      value += index >= apart ? other : 0;
    }
    return value;
#else
    return static_cast<int32_t>(
        Lanes::of_all(static_cast<uint32_t>(value),
                      [index](uint32_t sum, uint32_t one, int member) { return member <= index ? sum + one : sum; }));
#endif
  }

 private:
  Words& words_;
};

}  // namespace giga
