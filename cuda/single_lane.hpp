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

  class List {
   public:
    GIGA_HD explicit List(const RoomyLane& lane) : places_(lane.words_) {}
    GIGA_HD void clear() { size_ = 0; }
    GIGA_HD bool empty() const { return size_ == 0; }
    GIGA_HD bool has_room() const { return size_ <= OneWorker::kListed - kAtOnce; }
    GIGA_HD void add(bool wanted, int32_t place) {
      if (wanted) places_[size_ * kWarp] = place;
      size_ += wanted ? 1 : 0;
    }
    template <class F>
    GIGA_HD void ask(F&& f) {
      yes_ = ask_in_turn(0, 1, size_, [&](int k, int turn) { return f(places_[k * kWarp], turn); });
    }
    GIGA_HD bool take(int32_t& place) {
      int at;
      if (!take_lowest(yes_, at)) return false;
      place = places_[at * kWarp];
      return true;
    }

   private:
    int32_t* places_;  // [kListed, kWarp], from the lane on
    int size_ = 0;
    uint32_t yes_ = 0;
  };

  template <int kSlots>
  class Slots {
    static_assert(kSlots <= kRoomyLaneSlots);

   public:
    GIGA_HD explicit Slots(const RoomyLane& lane) : agents_(lane.words_ + OneWorker::kListed * kWarp) {}
    GIGA_HD int32_t& operator[](uint32_t k) { return agents_[k * kWarp]; }

   private:
    int32_t* agents_;  // [kSlots, kWarp], from the lane on
  };

 private:
  int32_t* words_;
};

}  // namespace giga
