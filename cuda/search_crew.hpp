// SearchCrew: a warp, or half of one, as the crew of an agent (sim/crew.hpp), whose members read, ask and rank side by
// side (sim/grid_nearest_by_crew.hpp). Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "cuda/world_threads.hpp"
#include "sim/grid_nearest_by_crew.hpp"

namespace giga {

/// Sync: wait_for_warp() and any_of_warp(flag) of the warp.
template <int kLanes, class Sync>
class SearchCrew {
  static_assert(kLanes == kWarp || kLanes == kWarp / 2);

  /// Of a warp, in shared memory.
  struct Words {
    CrewSearch<kLanes> search[kWarp / kLanes];
#if !defined(__CUDA_ARCH__)
    uint32_t said[kWarp];  // there are no shuffles
#endif
  };

 public:
  static constexpr bool kRanksTogether = true;
  static constexpr int kWidth = kLanes;
  static constexpr int kWords =
      (sizeof(CrewSearch<kLanes>) * kWarp / kLanes + sizeof(uint32_t) * kWarp) / sizeof(uint32_t);  ///< of a warp

  /// `words`: [kStageNumbers] of the warp, at least kWords.
  GIGA_HD SearchCrew(Sync sync, int lane, void* words)
      : sync_(sync), lane_(lane), words_(*static_cast<Words*>(words)) {}

  GIGA_HD int index() const { return lane_ % kLanes; }
  GIGA_HD bool leads() const { return index() == 0; }
  GIGA_HD void meet() const { sync_.wait_for_warp(); }
  GIGA_HD CrewSearch<kLanes>& search() const { return words_.search[lane_ / kLanes]; }
  /// Instead of the search: what members put together of a row.
  GIGA_HD float* stage() const { return crew_stage<kLanes>(&words_, lane_); }
  /// `flag`: the same for all members.
  GIGA_HD bool any(bool flag) const {
    if constexpr (kLanes == kWarp) return flag;
    return sync_.any_of_warp(flag);
  }
  GIGA_HD uint32_t ballot(bool flag) const {
#if defined(__CUDA_ARCH__)
    const uint32_t all = __ballot_sync(~0u, flag);
    return kLanes == kWarp ? all : all >> (lane_ - index()) & 0xFFFFu;
#else
    return of_all(flag ? 1u : 0u, [](uint32_t bits, uint32_t one, int k) { return bits | one << k; });
#endif
  }
  GIGA_HD int32_t from(int32_t value, int k) const {
#if defined(__CUDA_ARCH__)
    return __shfl_sync(~0u, value, k, kLanes);
#else
    return static_cast<int32_t>(of_all(static_cast<uint32_t>(value), [k](uint32_t known, uint32_t one, int member) {
      return member == k ? one : known;
    }));
#endif
  }
  /// Of the members up to this one.
  GIGA_HD int32_t sum_up_to(int32_t value) const {
#if defined(__CUDA_ARCH__)
    GIGA_UNROLL
    for (int apart = 1; apart < kLanes; apart *= 2) {
      const int32_t other = __shfl_up_sync(~0u, value, apart, kLanes);
      value += index() >= apart ? other : 0;
    }
    return value;
#else
    return static_cast<int32_t>(of_all(static_cast<uint32_t>(value), [this](uint32_t sum, uint32_t one, int member) {
      return member <= index() ? sum + one : sum;
    }));
#endif
  }

 private:
#if !defined(__CUDA_ARCH__)
  /// hear_members of the crew.
  template <class F>
  uint32_t of_all(uint32_t value, F&& f) const {
    return hear_members(sync_, words_.said, lane_, lane_ - index(), kLanes, value, f);
  }
#endif

  Sync sync_;
  int lane_;
  Words& words_;
};

}  // namespace giga
