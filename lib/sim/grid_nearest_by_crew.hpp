// The agents of a row, as grid_nearest.hpp finds them, where a warp or half of one looks for an agent: its members
// enter ranges of cells side by side, each asks about an agent, and each keeps one of the nearest. A lane that looks
// alone, or a crew of some lanes, comes to one short range after the other, and waits for memory at each.
#pragma once

#include <cstdint>
#include <type_traits>

#include "core/geometry.hpp"
#include "sim/crew.hpp"
#include "sim/grid.hpp"
#include "sim/grid_nearest.hpp"

namespace giga {

/// A crew as in cuda/search_crew.hpp, of as many members as a row has agents, or more. index(), leads(), meet(),
/// any(flag), ballot(flag) as other crews (crew.hpp); from(value, member), sum_up_to(value) of the members up to this
/// one; search(): the memory that they share.
template <class Crew>
concept RankingCrew = requires {
  requires Crew::kRanksTogether;
};

/// Rings of cells that a crew enters at once: 49 cells of one agent on average. With 2 and 4 rings 49.1 and 49.6 M
/// agent-steps/s instead of 49.7 M (1,000 against 1,000, crowded, by warps, one H200).
constexpr int kFirstRingOfCrew = 3;

/// A rank as a number of the same order: the bits of the distance, which is not negative, above the agent.
GIGA_HD uint64_t rank_key(const RowOrder::Rank& rank) {
  return static_cast<uint64_t>(float_bits(rank.distance)) << 32 | rank.agent;
}
constexpr uint64_t kLastRank = ~uint64_t{0};  ///< behind all others; its agent is kNoAgent

/// What the members share.
template <int kMembers>
struct CrewSearch {
  static constexpr int kListed = 2 * kMembers;
  int32_t places[kListed];                                               // of agents that are asked about
  uint64_t given[kMembers];                                              // keys of those that members hand in
  uint64_t before[NearestAgents::kMost], nearest[NearestAgents::kMost];  // of the nearest so far, and with these
};

/// The nearest of the agents that are shown to one: member k keeps the key of number k.
template <RankingCrew Crew>
class CrewNearest {
 public:
  static constexpr int kMost = NearestAgents::kMost;

  GIGA_HD explicit CrewNearest(const Crew& crew) : crew_(crew) {}
  GIGA_HD int size() const { return size_; }
  /// Whether an agent would be one of them, as far as is known.
  GIGA_HD bool wants(const RowOrder::Rank& rank) const { return rank_key(rank) < last_; }
  /// Whether agents that lie that far off, or farther, are not among them.
  GIGA_HD bool all_nearer_than(float distance) const {
    const float d = distance * 0.9999f;
    return d > 0 && float_bits(d) > static_cast<uint32_t>(last_ >> 32);
  }
  /// Takes the ones that members hand in: each comes behind as many as are nearer. All crews of the warp come to it.
  GIGA_HD void take(bool gives, const RowOrder::Rank& rank) {
    const uint32_t all = crew_.ballot(gives);
    if (!crew_.any(all != 0)) return;
    auto& shared = crew_.search();
    const int index = crew_.index(), n_given = count_bits(all);
    const uint64_t key = rank_key(rank);
    if (index < size_) shared.before[index] = own_;
    if (gives) shared.given[count_bits(all & ((1u << index) - 1u))] = key;
    crew_.meet();
    int own_place = index, place = 0;
    GIGA_UNROLL_BY(4)
    for (int k = 0; k < n_given; ++k) {
      const uint64_t other = shared.given[k];
      own_place += other < own_ ? 1 : 0;
      place += other < key ? 1 : 0;
    }
    GIGA_UNROLL_BY(4)
    for (int k = 0; k < size_; ++k) place += shared.before[k] < key ? 1 : 0;
    if (index < size_ && own_place < kMost) shared.nearest[own_place] = own_;
    if (gives && place < kMost) shared.nearest[place] = key;
    size_ = size_ + n_given < kMost ? size_ + n_given : kMost;
    crew_.meet();
    if (index < size_) own_ = shared.nearest[index];
    if (size_ == kMost) last_ = shared.nearest[kMost - 1];
  }
  /// The agent of row `index` of this member, of kMost; kNoAgent = there is none.
  GIGA_HD uint32_t agent() const { return static_cast<uint32_t>(own_); }

 private:
  const Crew& crew_;
  int size_ = 0;
  uint64_t own_ = kLastRank, last_ = kLastRank;
};

/// The hook of grid_look.hpp: what rank_seen of grid_nearest.hpp does, to the last bit. By distances as they are, so
/// that nothing is left to look at closer.
template <RankingCrew Crew, class Seen>
GIGA_HD void rank_seen(const Crew& crew, const GridParameters auto& p, GridWorld& w, int e, bool some, float reach,
                       bool sees_itself, const Seen& seen) {
  constexpr int kWidth = Crew::kWidth, kMost = NearestAgents::kMost;
  using Search = CrewSearch<kWidth>;
  static_assert(kMost < kWidth);
  static_assert(std::remove_cvref_t<decltype(p)>::n_neighbors == kMost + 1);
  const RowOrder order{w.x[e], w.y[e]};
  int32_t* const places = crew.search().places;
  CrewNearest<Crew> nearest(crew);
  int listed = 0;
  const auto ask = [&] {
    crew.meet();
    GIGA_ROLLED
    for (int front = 0; crew.any(front < listed); front += kWidth) {
      bool yes = false;
      RowOrder::Rank rank{};
      if (front + crew.index() < listed) {
        const int32_t place = places[front + crew.index()];
        const PlacedAgent a = w.placed[place];
        rank = order.rank(a);
        // Those that were asked before may lie nearer.
        Answer answer = nearest.wants(rank) ? Answer::ask_again : Answer::no;
        GIGA_ROLLED
        for (int turn = 0; answer == Answer::ask_again; ++turn) answer = seen.ask(a, place, turn);
        yes = answer == Answer::yes;
      }
      nearest.take(yes, rank);
    }
    crew.meet();
    listed = 0;
  };
  // One agent lies in a cell, on average. Where none beyond the next cells matters, these will do.
  const bool all = min_of(w.grid.size_x, w.grid.size_y) - p.margin > reach;
  Rings rings(p, w, order.x, order.y, all ? 1 : kFirstRingOfCrew);
  GIGA_ROLLED
  for (bool more = some; crew.any(more);) {
    const int parts = more ? rings.parts() : 0;
    GIGA_ROLLED
    for (int front = 0; crew.any(front < parts); front += kWidth) {
      const int part = front + crew.index();
      const CellRange range = part < parts ? rings.part(part) : CellRange{0, 0};
      const int32_t up_to = crew.sum_up_to(range.end - range.begin), before = up_to - (range.end - range.begin);
      const int32_t agents = crew.from(up_to, kWidth - 1);
      GIGA_ROLLED
      for (int base = 0; crew.any(base < agents); base += kWidth) {
        // Whose range has the item of this member: as many ranges end before it.
        const int item = base + crew.index();
        int of = 0;
        GIGA_UNROLL
        for (int half = kWidth / 2; half > 0; half /= 2) of += crew.from(up_to, of + half - 1) <= item ? half : 0;
        const int32_t place = crew.from(range.begin - before, of) + item;
        bool wanted = item < agents;
        if (wanted) {
          const PlacedAgent a = w.placed[place];
          const float dx = a.x - order.x, dy = a.y - order.y;
          wanted = a.agent != e && nearest.wants(order.rank(a)) && seen.worth_asking(a, dx * dx + dy * dy);
        }
        const uint32_t bits = crew.ballot(wanted);
        if (wanted) places[listed + count_bits(bits & ((1u << crew.index()) - 1u))] = place;
        listed += count_bits(bits);
        if (crew.any(listed > Search::kListed - kWidth)) ask();
      }
    }
    const float far = rings.widen();
    more = more && far < INFINITY && far <= reach;
    // Before there may be enough of them no answer ends the search.
    if (crew.any(listed > 0 && (!more || nearest.size() + listed >= kMost))) ask();
    more = more && !nearest.all_nearer_than(far);
  }
  if (!some) return;
  AgentNumber* const rows = w.neighbors + static_cast<int64_t>(e) * (kMost + 1);
  if (crew.leads()) rows[0] = AgentNumber{sees_itself ? static_cast<uint32_t>(e) : kNoAgent};
  if (crew.index() < kMost) rows[1 + crew.index()] = AgentNumber{nearest.agent()};
}

}  // namespace giga
