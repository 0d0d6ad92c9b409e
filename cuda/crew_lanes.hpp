// CrewLanes: some lanes of a warp that lie side by side, as a crew (sim/crew.hpp), and what they tell each other. Plain
// host-device code, as executor.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "cuda/world_threads.hpp"

namespace giga {

/// Sync: wait_for_warp() and any_of_warp(flag) of the warp.
template <int kLanes, class Sync>
class CrewLanes {
  static_assert(kLanes > 1 && kWarp % kLanes == 0);

 public:
  static constexpr int kWidth = kLanes;

  GIGA_HD int index() const { return lane_ % kLanes; }
  GIGA_HD bool leads() const { return index() == 0; }
  /// A warp goes one way anyway: the flag is the same for all of a crew.
  GIGA_HD bool any(bool flag) const {
    if constexpr (kLanes == kWarp) return flag;
    return sync_.any_of_warp(flag);
  }
  GIGA_HD void meet() const { sync_.wait_for_warp(); }
  GIGA_HD uint32_t ballot(bool flag) const {
#if defined(__CUDA_ARCH__)
    const uint32_t all = __ballot_sync(~0u, flag);
    return kLanes == kWarp ? all : all >> (lane_ - index()) & ((1u << kLanes % kWarp) - 1u);
#else
    return of_all(flag ? 1u : 0u, [](uint32_t bits, uint32_t one, int k) { return bits | one << k; });
#endif
  }
  template <class T>
  GIGA_HD T from(T value, int k) const {
#if defined(__CUDA_ARCH__)
    return __shfl_sync(~0u, value, k, kLanes);
#else
    return static_cast<T>(of_all(static_cast<uint32_t>(value),
                                 [k](uint32_t known, uint32_t one, int member) { return member == k ? one : known; }));
#endif
  }

 protected:
  /// `said`: [kWarp] of the warp, where there are no shuffles; else null.
  GIGA_HD CrewLanes(Sync sync, int lane, [[maybe_unused]] uint32_t* said) : sync_(sync), lane_(lane) {
#if !defined(__CUDA_ARCH__)
    said_ = said;
#endif
  }
#if !defined(__CUDA_ARCH__)
  /// hear_members of the crew.
  template <class F>
  uint32_t of_all(uint32_t value, F&& f) const {
    return hear_members(sync_, said_, lane_, lane_ - index(), kLanes, value, f);
  }
#endif

  Sync sync_;
  int lane_;
#if !defined(__CUDA_ARCH__)
 private:
  uint32_t* said_;
#endif
};

}  // namespace giga
