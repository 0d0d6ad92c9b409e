// SingleLane and RoomyLane: a lane as a crew of itself (sim/crew.hpp), whose warp goes from agent to agent together.
// Plain host-device code, as executor.hpp.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "cuda/world_threads.hpp"
#include "sim/crew.hpp"

namespace giga {

/// Sync: wait_for_warp() of the warp.
template <class Sync>
class SingleLane : public OneWorker {
 public:
  GIGA_HD explicit SingleLane(Sync sync) : sync_(sync) {}
  GIGA_HD void meet() const { sync_.wait_for_warp(); }

 private:
  Sync sync_;
};

constexpr int kRoomyLaneSlots = 16;
/// Of shared memory that the roomy lanes of a warp need.
constexpr int kRoomyLaneWords = (OneWorker::kListed + kRoomyLaneSlots) * kWarp;

/// One whose lists are in shared memory. What is addressed by numbers that are not constants lies in memory, and
/// memory of the lane's own is written through to the L2 cache, each number as a sector of its own: that was four
/// fifths of what a million agents wrote where they looked.
template <class Sync>
class RoomyLane : public SingleLane<Sync> {
 public:
  /// swarm_million, one H100: with one 461 M agent-steps/s, with four 470 M instead of 482 M.
  static constexpr int kAtOnce = 2;

  /// `words`: [kRoomyLaneWords] of its warp.
  GIGA_HD RoomyLane(Sync sync, int lane, int32_t* words) : SingleLane<Sync>(sync), words_(words + lane) {}

  /// [kNumbers, kWarp] from word `kFirst` of the lane on.
  template <int kFirst, int kNumbers>
  class Shared {
    static_assert((kFirst + kNumbers) * kWarp <= kRoomyLaneWords);

   public:
    GIGA_HD explicit Shared(const RoomyLane& lane) : numbers_(lane.words_ + kFirst * kWarp) {}
    GIGA_HD int32_t& operator[](uint32_t k) { return numbers_[k * kWarp]; }

   private:
    int32_t* numbers_;
  };
  template <int kSlots>
  using Slots = Shared<OneWorker::kListed, kSlots>;
  using List = LoneList<Shared<0, OneWorker::kListed>, OneWorker::kListed, kAtOnce, false>;

 private:
  int32_t* words_;
};

}  // namespace giga
