// Whom an agent sees in a world of many agents (rules 6 and 17.3): whom it hears, and of whom it is told by those.
#pragma once

#include <type_traits>

#include "sim/communication.hpp"
#include "sim/grid.hpp"
#include "sim/grid_nearest.hpp"
#include "sim/sight.hpp"

namespace giga {

/// What an agent is asked first.
GIGA_HD uint32_t marks_of_agent(const GridParameters auto& p, const GridWorld& w, int i) {
  const int32_t observers = w.observers[i];
  const int told = observers <= kKeptDetectors ? observers : kKeptDetectors + 1;
  return (w.alive[i] ? kLives : 0u) | (observers > 0 ? kObserved : 0u) | (p.team_of(i) == 1 ? kOfTeam1 : 0u) |
         static_cast<uint32_t>(told) << kObserversShift;
}

/// Notes that with the placed agents. Before `listen` and `look`.
template <class Lanes>
GIGA_HD void mark_agents(const Lanes& lanes, const GridParameters auto& p, GridWorld& w, int n) {
  lanes.each(n > 0 ? w.cell_begin[w.grid.cells()] : 0,
             [&](int k) { w.placed[k].marks = marks_of_agent(p, w, w.placed[k].agent); });
}

GIGA_HD int team_of(const PlacedAgent& a) { return (a.marks & kOfTeam1) ? 1 : 0; }

/// Whom an agent hears, and is told of by whom it hears.
template <class P, class Draws>
struct Listener {
  const P& p;
  const GridWorld& w;
  Draws& draws;
  int e, team;
  float x, y;  // of e
  bool after_reset;

  GIGA_HD bool in_earshot(float d2) const { return d2 <= p.hearing_reach * p.hearing_reach; }
  GIGA_HD bool worth_asking(const PlacedAgent& a, float d2) const {
    return (a.marks & (team_of(a) != team ? kObserved : in_earshot(d2) ? kLives : 0u)) != 0;
  }
  /// Whether it hears one of its team; itself if it lives.
  GIGA_HD bool hears(const PlacedAgent& b) const {
    const float dx = b.x - x, dy = b.y - y, d2 = dx * dx + dy * dy;
    if (!(b.marks & kLives) || !in_earshot(d2)) return false;
    const float draw = draws.comm(e, b.agent, after_reset);
    const Hearing rough = roughly_hears_at(p, d2, draw);
    return b.agent == e || (rough.clear ? rough.heard : hears_at(p, d2, draw));
  }
  /// About a mate: whether it is heard. About an opponent: whether one that detects it is, turn by turn. One place in
  /// the code where they are, so that workers that ask about both need not wait for each other.
  GIGA_HD Answer ask(const PlacedAgent& a, int k, int turn) const {
    const bool mate = team_of(a) == team;
    if (!mate && turn == kKeptDetectors) return told_by_any(a) ? Answer::yes : Answer::no;
    const int sender = mate ? k : w.detectors[static_cast<int64_t>(k) * kKeptDetectors + turn];
    if (hears(w.placed[sender])) return Answer::yes;
    return mate || turn + 1 == static_cast<int>(a.marks >> kObserversShift) ? Answer::no : Answer::ask_again;
  }
  /// Of all that detect it, where they are more than are kept.
  GIGA_HD bool told_by_any(const PlacedAgent& a) const {
    bool told = false;
    for_near(OneWorker{}, p, w, a.x, a.y, p.sight_reach[team], [&](int k, int b, float) {
      if (told || p.team_of(b) != team || !w.could_see[b] || !hears(w.placed[k])) return;
      told = sight(p, w, a.agent, b, [&] { return draws.detect(a.agent, b); }).detected;
    });
    return told;
  }
};

/// Rules 6 and 7.1 with stochastic communication: whom e sees decides who hears whom, asked for those agents alone that
/// may have a row.
template <class Crew, class Draws>
GIGA_HD void listen(const Crew& crew, const GridParameters auto& p, GridWorld& w, Draws& draws, int e, bool some,
                    bool after_reset) {
  const int team = p.team_of(e);
  rank_seen(crew, p, w, e, some, p.hearing_reach + p.sight_reach[team] + p.margin, w.alive[e] != 0,
            Listener<std::remove_cvref_t<decltype(p)>, Draws>{p, w, draws, e, team, w.x[e], w.y[e], after_reset});
}

/// Whom an agent sees where all mates are heard.
struct Onlooker {
  int team;
  GIGA_HD bool worth_asking(const PlacedAgent& a, float) const {
    return (a.marks & (team_of(a) == team ? kLives | kObserved : kObserved)) != 0;
  }
  GIGA_HD Answer ask(const PlacedAgent&, int, int) const { return Answer::yes; }
};

/// The same without it: all living mates, and whomever anybody detects.
template <class Crew>
GIGA_HD void look(const Crew& crew, const GridParameters auto& p, GridWorld& w, int e, bool some) {
  rank_seen(crew, p, w, e, some, INFINITY, w.alive[e] || w.observers[e] > 0, Onlooker{p.team_of(e)});
}

/// The hook of step.hpp.
template <class Crew, class Draws>
GIGA_HD void look_around(const Crew& crew, const GridParameters auto& p, GridWorld& w, Draws& draws, bool after_reset,
                         int e, bool some) {
  if (p.stochastic_communication)
    listen(crew, p, w, draws, e, some, after_reset);
  else
    look(crew, p, w, e, some);
}
template <class Draws>
GIGA_HD void look_around(const GridParameters auto& p, GridWorld& w, Draws& draws, bool after_reset, int e) {
  look_around(OneWorker{}, p, w, draws, after_reset, e, true);
}

/// The rows are ranked when it is decided whom an agent sees, and kept as state.
GIGA_HD void rank_neighbors(const GridParameters auto&, GridWorld&, int) {}

}  // namespace giga
