// The agents of a row in a world of many agents (rules 17.3): the nearest of those that are shown to an agent, found by
// place. Who is shown is said by what is handed in (grid_look.hpp).
#pragma once

#include <type_traits>

#include "core/geometry.hpp"
#include "sim/crew.hpp"
#include "sim/grid.hpp"
#include "sim/observations.hpp"

namespace giga {

/// The nearest of the agents that are shown to it, for the rows of an observation. An agent is a key: its squared
/// distance, whose lowest bits give way to the number of the slot in which its number is kept. Keys in registers and no
/// branches, so that the lanes of a warp, each with an agent of its own, keep in step; a new one takes two instructions
/// a row. Where keys lie so near each other that they leave open who comes first, whoever reads them looks closer:
/// squares whose roots are equal lie within four of the smallest steps.
class NearestAgents {
 public:
  static constexpr int kMost = 14;  ///< all others of a row of the usual length
  /// Of all keys, and one that is free. Slots are the crew's, apart from the keys: what is addressed by numbers that
  /// are not constants lies in memory.
  static constexpr int kSlots = 16;

  GIGA_HD NearestAgents() {
    // Keys of nobody lie behind all others, and far from each other.
    GIGA_UNROLL
    for (uint32_t k = 0; k <= kMost; ++k) key_[k] = kNobodyKey + k * 2 * kUnclear + k;
  }
  /// Whether an agent at that squared distance may be one of them.
  GIGA_HD bool wants(float d2) const { return float_bits(d2) < key_[kMost - 1] + kUnclear; }
  template <class Slots>
  GIGA_HD void take(float d2, int agent, Slots& slots) {
    slots[free_] = agent;
    const uint32_t key = (float_bits(d2) & ~kSlotBits) | free_;
    free_ = max_of(key_[kMost], key) & kSlotBits;  // of the one that is left out
    // No step waits for another: by old values alone.
    GIGA_UNROLL
    for (int k = kMost; k > 0; --k) key_[k] = max_of(key_[k - 1], min_of(key_[k], key));
    key_[0] = min_of(key_[0], key);
  }
  /// Whether agents that lie that far off, or farther, are not among them.
  GIGA_HD bool all_nearer_than(float distance) const {
    const float d = distance * 0.9999f;
    return distance > 0 && key_[kMost - 1] < kNobodyKey && float_bits(d * d) > (key_[kMost - 1] | kSlotBits);
  }
  /// The agent of row k; -1 = there is none (kNoAgent).
  template <class Slots>
  GIGA_HD int agent(int k, Slots& slots) const {
    return key_[k] < kNobodyKey ? slots[key_[k] & kSlotBits] : -1;
  }
  /// Bit k: whether number k + 1 might come before number k. One that is left out might, in the place of the last.
  GIGA_HD uint32_t unclear() const {
    uint32_t bits = 0;
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) bits |= key_[k + 1] - key_[k] < kUnclear ? 1u << k : 0u;
    return bits;
  }

 private:
  static constexpr uint32_t kSlotBits = kSlots - 1, kUnclear = 2 * kSlots, kNobodyKey = 0x80000000u;
  static_assert(kSlots >= kMost + 2);
  GIGA_HD static uint32_t min_of(uint32_t a, uint32_t b) { return b < a ? b : a; }
  GIGA_HD static uint32_t max_of(uint32_t a, uint32_t b) { return b > a ? b : a; }

  uint32_t key_[kMost + 1];  // the last only to be compared with the one before
  uint32_t free_ = kMost + 1;
};

/// How rows are ordered: by distance from a place, equally near ones by number.
struct RowOrder {
  float x, y;
  struct Rank {
    float distance;
    uint32_t agent;
    GIGA_HD bool before(const Rank& other) const {
      return distance < other.distance || (distance == other.distance && agent < other.agent);
    }
  };
  GIGA_HD Rank rank(const PlacedAgent& a) const {
    return {order_distance(a.x - x, a.y - y), static_cast<uint32_t>(a.agent)};
  }
  GIGA_HD Rank rank(const GridWorld& w, AgentNumber a) const {
    return {order_distance(w.x[a] - x, w.y[a] - y), a.value};
  }
  /// Moves the agent of row k forward to where it belongs among those before it.
  GIGA_HD void sink(const GridWorld& w, AgentNumber* rows, int k) const {
    GIGA_ROLLED
    for (; k > 0 && rank(w, rows[k]).before(rank(w, rows[k - 1])); --k) {
      const AgentNumber other = rows[k - 1];
      rows[k - 1] = rows[k];
      rows[k] = other;
    }
  }
};

/// The same as rank_seen does, one by one and with nothing but distances and numbers: where keys leave open who has the
/// last row. `rows`: [most], of agents behind `after`.
template <class Seen>
GIGA_HD void rank_exactly(const GridParameters auto& p, const GridWorld& w, int e, float reach, const RowOrder& order,
                          RowOrder::Rank after, const Seen& seen, AgentNumber* rows, int most) {
  int n = 0;
  const auto last = [&] { return order.rank(w, rows[n - 1]); };
  for_rings(
      p, w, order.x, order.y, 1,
      [&](float far) { return far > reach || (n == most && far * 0.9999f > last().distance); },
      [&](int k) {
        const PlacedAgent a = w.placed[k];
        const RowOrder::Rank rank = order.rank(a);
        if (a.agent == e || !after.before(rank) || (n == most && !rank.before(last()))) return;
        if (!seen.worth_asking(a, planar_distance2(w, e, a.agent))) return;
        Answer answer = Answer::ask_again;
        GIGA_ROLLED
        for (int turn = 0; answer == Answer::ask_again; ++turn) answer = seen.ask(a, k, turn);
        if (answer == Answer::no) return;
        if (n < most) ++n;
        rows[n - 1] = AgentNumber{rank.agent};
        order.sink(w, rows, n - 1);
      });
  for (; n < most; ++n) rows[n] = kNobody;
}

/// The agents of e's rows (rules 7.1), nearest first, equally near ones by number: of those that `seen` says yes to,
/// which are asked only if they would have a row, and of which none lies beyond `reach`. Looks no farther than the last
/// row. Longer rows than the usual are put together of several searches. By turns agents are listed and those listed
/// are asked: each is a short loop, so that workers with agents of their own are in the same one. The members of a crew
/// share both, and each keeps all of the nearest: to take one is a few instructions, to put theirs together is more.
/// `some`: whether the crew has an agent.
///   seen.worth_asking(placed agent, squared distance)   what can be told at once
///   seen.ask(placed agent, its place, turn)             turn 0, 1, ... while it says ask_again
template <class Crew, class Seen>
GIGA_HD void rank_seen(const Crew& crew, const GridParameters auto& p, GridWorld& w, int e, bool some, float reach,
                       bool sees_itself, const Seen& seen) {
  constexpr int kMost = NearestAgents::kMost, kEach = Crew::kAtOnce / Crew::kWidth;
  const int limit = p.n_neighbors;
  // Crews of a warp go through the search below together, so once.
  if constexpr (Crew::kWidth > 1) static_assert(std::remove_cvref_t<decltype(p)>::n_neighbors <= kMost + 1);
  const bool writes = some && crew.leads();
  AgentNumber* rows = w.neighbors + static_cast<int64_t>(e) * limit;
  if (writes) {
    rows[0] = AgentNumber{static_cast<uint32_t>(e)};
    if (!sees_itself) rows[0] = kNobody;
  }
  const RowOrder order{w.x[e], w.y[e]};
  const int column = w.grid.column(order.x), row = w.grid.row(order.y);
  // Where agents are crowded the next cells hold enough of them, and where they are far apart nobody beyond matters.
  int crowd = 0;
  const int left = column > 0 ? column - 1 : 0, right = column + 1 < w.grid.columns ? column + 1 : column;
  GIGA_UNROLL
  for (int apart = -1; apart <= 1; ++apart) {  // all are read before any is added
    const int at = row + apart;
    const bool there = at >= 0 && at < w.grid.rows;
    const CellRange range = w.cells(there ? at : row, left, right);
    crowd += there ? range.end - range.begin : 0;
  }
  const bool all = min_of(w.grid.size_x, w.grid.size_y) - p.margin > reach;
  const int first = !all && crowd < 2 * kMost ? 2 : 1;
  RowOrder::Rank after{-1, 0};
  GIGA_ROLLED
  for (int done = 1; done < limit; done += kMost) {
    const int most = limit - done < kMost ? limit - done : kMost;
    NearestAgents nearest;
    typename Crew::template Slots<NearestAgents::kSlots> slots(crew);
    Rings rings(p, w, order.x, order.y, first);
    typename Crew::List list(crew);
    bool more = some;
    GIGA_ROLLED
    while (crew.any(more)) {
      list.clear();
      bool lists = more;
      GIGA_ROLLED
      while (crew.any(lists)) {
        bool in_ring = lists && rings.enter();
        if constexpr (Crew::kWidth > 1)
          while (in_ring && !rings.some_left()) in_ring = rings.enter();
        if (lists && !in_ring) {
          lists = list.empty();  // else who has been listed decides whether any beyond matter
          if (lists) {
            const float far = rings.widen();
            lists = more = far < INFINITY && far <= reach && !nearest.all_nearer_than(far);
          }
        }
        // Lanes of a warp that look alone enter rows together, and each goes through its own; the compiler has them
        // wait for each other behind that. No meet(): each leaves the loop around this at its own time.
        bool tests = in_ring && rings.some_left();
        do {
          bool wanted[kEach] = {};
          int32_t k[kEach] = {};
          if (tests) {
            const CellRange next = rings.take(Crew::kAtOnce);
            PlacedAgent placed[kEach];
            GIGA_UNROLL
            for (int j = 0; j < kEach; ++j) {
              const int32_t at = next.begin + crew.index() + j * Crew::kWidth;
              wanted[j] = Crew::kAtOnce == 1 || at < next.end;
              k[j] = wanted[j] ? at : next.begin;
              placed[j] = w.placed[k[j]];
            }
            GIGA_UNROLL
            for (int j = 0; j < kEach; ++j) {
              const PlacedAgent a = placed[j];
              const float dx = a.x - order.x, dy = a.y - order.y, d2 = dx * dx + dy * dy;
              wanted[j] &= nearest.wants(d2) & (a.agent != e) & seen.worth_asking(a, d2);
              if (done > 1) wanted[j] = wanted[j] && after.before(order.rank(a));
            }
          }
          GIGA_UNROLL
          for (int j = 0; j < kEach; ++j) list.add(wanted[j], k[j]);
          tests = tests && rings.some_left() && list.has_room();
        } while (Crew::kWidth == 1 && tests);
        lists = lists && list.has_room();
      }
      list.ask([&](int32_t k, int turn) { return seen.ask(w.placed[k], k, turn); });
      int32_t place;
      GIGA_ROLLED
      while (list.take(place)) {
        const PlacedAgent a = w.placed[place];
        const float dx = a.x - order.x, dy = a.y - order.y;
        nearest.take(dx * dx + dy * dy, a.agent, slots);
      }
    }
    if (!writes) return;
    AgentNumber* to = rows + done;
    GIGA_UNROLL
    for (int k = 0; k < kMost; ++k) {
      const int agent = nearest.agent(k, slots);
      if (k < most) to[k] = AgentNumber{static_cast<uint32_t>(agent)};
    }
    uint32_t unclear = nearest.unclear();
    if (unclear != 0) {  // hardly ever
      unclear &= (1u << most) - 1u;
      if (unclear >> (most - 1) != 0)
        rank_exactly(p, w, e, reach, order, after, seen, to, most);
      else
        for (; unclear != 0; unclear &= unclear - 1) order.sink(w, to, lowest_bit(unclear) + 1);
    }
    if (done + kMost >= limit) return;
    if (to[kMost - 1] == kNobody) {
      for (int k = done + kMost; k < limit; ++k) rows[k] = kNobody;
      return;
    }
    after = order.rank(w, to[kMost - 1]);
  }
}

}  // namespace giga
