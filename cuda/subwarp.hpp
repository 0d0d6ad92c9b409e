// Subwarp: some lanes of a warp as a crew (sim/crew.hpp). Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "cuda/crew_lanes.hpp"
#include "sim/crew.hpp"
#include "sim/grid_sort.hpp"

namespace giga {

/// Sync: wait_for_warp() and any_of_warp(flag) of the warp.
template <int kLanes, class Sync>
class Subwarp : public CrewLanes<kLanes, Sync> {
  static_assert(kLanes < kWarp);
  using Lanes = CrewLanes<kLanes, Sync>;
  static constexpr int kCrews = kWarp / kLanes;
  static constexpr int kListed = 8 * kLanes < 32 ? 8 * kLanes : 32;  // of a crew

  /// Of a warp, in shared memory.
  struct Words {
    int32_t places[kCrews][kListed];
    uint32_t said[kWarp];  // where there are no shuffles
  };

 public:
  static constexpr int kAtOnce = kLanes;
  static constexpr int kWords = sizeof(Words) / sizeof(uint32_t);  ///< of shared memory, of a warp

  /// `words`: [kStageNumbers] of its warp, at least kWords.
  GIGA_HD Subwarp(Sync sync, int lane, void* words)
      : Lanes(sync, lane, static_cast<Words*>(words)->said), warp_(*static_cast<Words*>(words)) {}

  /// Instead of lists: what members put together of a row.
  GIGA_HD float* stage() const { return crew_stage<kLanes>(&warp_, Lanes::lane_); }
  GIGA_HD uint32_t either(uint32_t bits) const {
#if defined(__CUDA_ARCH__)
    GIGA_UNROLL
    for (int apart = 1; apart < kLanes; apart *= 2) bits |= __shfl_xor_sync(~0u, bits, apart);
    return bits;
#else
    return Lanes::of_all(bits, [](uint32_t known, uint32_t one, int) { return known | one; });
#endif
  }
  GIGA_HD int32_t sum(int32_t value) const {
#if defined(__CUDA_ARCH__)
    GIGA_UNROLL
    for (int apart = 1; apart < kLanes; apart *= 2) value += __shfl_xor_sync(~0u, value, apart);
    return value;
#else
    return static_cast<int32_t>(
        Lanes::of_all(static_cast<uint32_t>(value), [](uint32_t known, uint32_t one, int) { return known + one; }));
#endif
  }

  class Counter {
   public:
    GIGA_HD explicit Counter(const Subwarp& crew) : crew_(crew) {
      if (crew.leads()) *crew.list() = 0;
      crew.sync_.wait_for_warp();
    }
    GIGA_HD int32_t take() { return take_number(crew_.list()); }
    GIGA_HD int32_t count() const {
      crew_.sync_.wait_for_warp();
      return *crew_.list();
    }

   private:
    const Subwarp& crew_;
  };

  class List {
   public:
    GIGA_HD explicit List(const Subwarp& crew) : crew_(crew) {}
    GIGA_HD void clear() {
      crew_.sync_.wait_for_warp();  // what stood in it has been read
      size_ = 0;
    }
    GIGA_HD bool empty() const { return size_ == 0; }
    GIGA_HD bool has_room() const { return size_ <= kListed - kLanes; }
    GIGA_HD void add(bool wanted, int32_t place) {
      const uint32_t all = crew_.ballot(wanted);
      if (wanted) crew_.list()[size_ + count_bits(all & ((1u << crew_.index()) - 1u))] = place;
      size_ += count_bits(all);
    }
    template <class F>
    GIGA_HD void ask(F&& f) {
      crew_.sync_.wait_for_warp();
      yes_ = crew_.either(
          ask_in_turn(crew_.index(), kLanes, size_, [&](int k, int turn) { return f(crew_.list()[k], turn); }));
    }
    GIGA_HD bool take(int32_t& place) {
      int at;
      if (!take_lowest(yes_, at)) return false;
      place = crew_.list()[at];
      return true;
    }

   private:
    const Subwarp& crew_;
    int size_ = 0;
    uint32_t yes_ = 0;
  };

  /// The members of a crew write theirs to neighboring words.
  template <int kSlots>
  using Slots = OneWorker::Slots<kSlots>;

 private:
  GIGA_HD int32_t* list() const { return warp_.places[Lanes::lane_ / kLanes]; }

  Words& warp_;
};

}  // namespace giga
