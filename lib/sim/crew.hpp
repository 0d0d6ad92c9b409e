// Crews: the workers that look for others together, for one agent. OneWorker is a crew of itself, and so is a lane of a
// GPU that looks alone (cuda/single_lane.hpp); where a GPU has more lanes than agents, some lanes of a warp are one
// (cuda/subwarp.hpp). A warp or half of one (cuda/search_crew.hpp) has a search of its own (grid_nearest_by_crew.hpp)
// and, of what stands here, what that needs.
//   kWidth, index(), leads()   how many they are, which of them this is, whether it is the first
//   any(flag)                  whether the flag of any worker of the warp is set. All crews of a warp go the same way:
//                              wherever they speak to each other all of them do, those without an agent too. A loop in
//                              which they do goes on while any of them has work. Workers that look alone have their
//                              own flag: each leaves such a loop by itself.
//   meet()                     after a loop that each leaves at its own time. Those of a warp go on together: the
//                              compiler may have them do the rest one after the other instead (a fight of a million:
//                              in eight turns). All lanes of the warp come to it equally often, those without an agent
//                              too: so never within such a loop
//   kAtOnce                    agents of a range that a crew reads before it looks at any; has_room() speaks of as many
//   ballot(flag)               bit k: the flag of member k
//   from(value, k), sum(value) the value of member k, of all members
//   Counter                    take(): 0, 1, ..., each to one member; count(): how many were taken
//   List                       places of agents that are asked about:
//                                add(wanted, place)   all members at the same time, while has_room()
//                                ask(f)               f(place, turn) for all of them, each member for some; turn 0, 1,
//                                                     ... while it says ask_again
//                                take(place)          the next that was answered with yes, for each member; false = all
//                                                     are taken. Apart from the questions: where lanes of a warp take
//                                                     at different times, all of them wait for each (a million agents,
//                                                     one H100: 411 M agent-steps/s instead of 403 M)
//                                clear(), empty()
//   stage()                    of several workers of a warp: memory in which they put together what they write of an
//                              agent, in the place of lists and searches; between two meet()
//   Slots<n>                   n agents that a worker keeps by number, for itself: slots[k]
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "sim/params.hpp"

namespace giga {

/// What is said about an agent that may have a row.
enum class Answer { no, yes, ask_again };

/// Takes the lowest of some bits; false = there is none.
GIGA_HD bool take_lowest(uint32_t& bits, int& at) {
  if (bits == 0) return false;
  at = lowest_bit(bits);
  bits &= bits - 1;
  return true;
}

/// Asks about items at, at + stride, ... below `size`, one after the other and each turn by turn: f(item, turn). Bit k:
/// yes to item k.
template <class F>
GIGA_HD uint32_t ask_in_turn(int at, int stride, int size, F&& f) {
  uint32_t yes = 0;
  int turn = 0;
  GIGA_ROLLED
  while (at < size) {
    const Answer answer = f(at, turn);
    yes |= answer == Answer::yes ? 1u << at : 0u;
    turn = answer == Answer::ask_again ? turn + 1 : 0;
    at += answer == Answer::ask_again ? 0 : stride;
  }
  return yes;
}

/// The list of a worker that looks alone. Numbers: int32_t& operator[](k), made from a crew; kSpare: it has one more
/// than the kMost that are listed, so that what is not wanted may be written and overwritten. kAtOnce: of the crew.
template <class Numbers, int kMost, int kAtOnce, bool kSpare>
class LoneList {
 public:
  template <class Crew>
  GIGA_HD explicit LoneList(const Crew& crew) : places_(crew) {}
  GIGA_HD void clear() { size_ = 0; }
  GIGA_HD bool empty() const { return size_ == 0; }
  GIGA_HD bool has_room() const { return size_ <= kMost - kAtOnce; }
  GIGA_HD void add(bool wanted, int32_t place) {
    if (wanted || kSpare) places_[static_cast<uint32_t>(size_)] = place;
    size_ += wanted ? 1 : 0;
  }
  template <class F>
  GIGA_HD void ask(F&& f) {
    yes_ = ask_in_turn(0, 1, size_, [&](int k, int turn) { return f(places_[static_cast<uint32_t>(k)], turn); });
  }
  GIGA_HD bool take(int32_t& place) {
    int at;
    if (!take_lowest(yes_, at)) return false;
    place = places_[static_cast<uint32_t>(at)];
    return true;
  }

 private:
  Numbers places_;
  int size_ = 0;
  uint32_t yes_ = 0;
};

struct OneWorker {
  static constexpr int kWidth = 1, kAtOnce = 1;
  /// Of a list. Whether more agents are asked depends on the answers of these: with 32 a million agents made 431 M
  /// agent-steps/s instead of 439 M (one H100, before lists were in shared memory).
  static constexpr int kListed = 16;
  GIGA_HD int index() const { return 0; }
  GIGA_HD bool leads() const { return true; }
  GIGA_HD bool any(bool flag) const { return flag; }
  GIGA_HD void meet() const {}
  GIGA_HD uint32_t ballot(bool flag) const { return flag ? 1 : 0; }
  GIGA_HD uint32_t from(uint32_t value, int) const { return value; }
  GIGA_HD int32_t sum(int32_t value) const { return value; }

  class Counter {
   public:
    GIGA_HD explicit Counter(const OneWorker&) {}
    GIGA_HD int32_t take() { return count_++; }
    GIGA_HD int32_t count() const { return count_; }

   private:
    int32_t count_ = 0;
  };

  template <int kSlots>
  class Slots {
   public:
    template <class Crew>
    GIGA_HD explicit Slots(const Crew&) {}
    GIGA_HD int32_t& operator[](uint32_t k) { return numbers_[k]; }

   private:
    int32_t numbers_[kSlots];
  };
  using List = LoneList<Slots<kListed + 1>, kListed, kAtOnce, true>;
};

}  // namespace giga
