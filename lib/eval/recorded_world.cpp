#include "eval/recorded_world.hpp"

#include <cmath>
#include <cstring>
#include <numbers>
#include <tuple>
#include <utility>

#include "core/error.hpp"
#include "sim/grid.hpp"

namespace giga {
namespace {

int16_t whole_multiple(float value, float unit) {
  const float count = std::round(value / unit);
  return static_cast<int16_t>(std::clamp(count, -32768.0f, 32767.0f));  // a NaN cannot come from a simulator
}

/// Every 64th of 65,536 headings of a turn, going round.
int16_t heading_number(float heading) {
  constexpr double kPerRadian = 1024 / (2 * std::numbers::pi);
  const auto at = static_cast<int64_t>(std::lround(static_cast<double>(heading) * kPerRadian));
  return static_cast<int16_t>(static_cast<uint16_t>(at * 64));
}

bool bit(const uint32_t* words, int k) { return words[k / 32] >> (k & 31) & 1u; }

ReplayDeath death_of(Death death) { return static_cast<ReplayDeath>(death); }
static_assert(static_cast<int>(ReplayDeath::out_of_bounds) == static_cast<int>(Death::out_of_bounds));

/// [rows, columns] of [columns, rows].
template <class T>
std::vector<T> transposed(const std::vector<T>& from, size_t columns, size_t rows) {
  std::vector<T> to(from.size());
  for (size_t c = 0; c < columns; ++c)
    for (size_t r = 0; r < rows; ++r) to[r * columns + c] = from[c * rows + r];
  return to;
}

/// What the dead do and their networks say has no effect, and costs as much room as what the living do.
void forget_the_dead(const SimParams& p, ReplayEpisode& e) {
  const auto states = static_cast<size_t>(e.steps) + 1;
  for (size_t i = 0; i < e.died.size(); ++i) {
    if (e.died[i] < 0) continue;
    const size_t died = static_cast<size_t>(e.died[i]), steps = states - 1;
    const size_t size = p.actions == ActionKind::discrete ? 1 : kActionSize * sizeof(float);
    const uint8_t nothing = p.actions == ActionKind::discrete ? 13 : 0;
    const auto action = e.action.begin() + static_cast<std::ptrdiff_t>(i * steps * size);
    std::fill(action + static_cast<std::ptrdiff_t>(died * size), action + static_cast<std::ptrdiff_t>(steps * size),
              nothing);
    const int team = team_of(p, static_cast<int>(i));
    const auto rows = static_cast<size_t>(n_minds(p, team)), row = i - (team ? static_cast<size_t>(p.n_team[0]) : 0);
    if (row >= rows) continue;
    ReplayMind& mind = e.mind[static_cast<size_t>(team)];
    for (std::vector<uint8_t>* column : {&mind.value, &mind.likely, &mind.probability})
      for (size_t first = row * states; first < column->size(); first += rows * states)
        std::fill(column->begin() + static_cast<std::ptrdiff_t>(first + died),
                  column->begin() + static_cast<std::ptrdiff_t>(first + states), uint8_t{0});
  }
}

/// What the networks of a team said.
ReplayMind mind_of(const RecordedWorld& w, const SimParams& p, int team) {
  const auto states = static_cast<size_t>(w.states);
  const bool discrete = p.actions == ActionKind::discrete;
  ReplayMind mind;
  const auto rows = static_cast<size_t>(n_minds(p, team));
  if (!w.values[team].empty()) {
    const std::vector<float> values = transposed(w.values[team], states, rows);
    mind.low = mind.high = values[0];
    const auto living = [&](size_t at) {
      const int died = w.died[at / states + (team ? static_cast<size_t>(p.n_team[0]) : 0)];
      return died < 0 || static_cast<int>(at % states) < died;
    };
    for (size_t at = 0; at < values.size(); ++at) {
      if (!living(at)) continue;
      mind.low = std::min(mind.low, values[at]);
      mind.high = std::max(mind.high, values[at]);
    }
    // The same value everywhere, perhaps one to which 1 adds nothing.
    if (!(mind.low < mind.high)) mind.high = std::max(mind.low + 1, std::nextafter(mind.low, INFINITY));
    for (size_t at = 0; at < values.size(); ++at)
      mind.value.push_back(living(at) ? static_cast<uint8_t>(std::lround((values[at] - mind.low) /
                                                                         (mind.high - mind.low) * kReplayValues))
                                      : uint8_t{0});
  }
  if (w.likely[team].empty()) return mind;
  mind.top = discrete ? kLikelyActions : 1;
  // [states, n, K] -> [K, n, states]
  const size_t per_row = discrete ? kLikelyActions : kActionSize;
  mind.likely = transposed(w.likely[team], states, rows * per_row);
  mind.probability = transposed(w.probability[team], discrete ? states : 0, rows * per_row);
  const auto by_rank = [&](std::vector<uint8_t>& column) {
    std::vector<uint8_t> to;
    for (size_t rank = 0; rank < per_row && !column.empty(); ++rank)
      for (size_t i = 0; i < rows; ++i) {
        const auto from = column.begin() + static_cast<std::ptrdiff_t>((i * per_row + rank) * states);
        to.insert(to.end(), from, from + static_cast<std::ptrdiff_t>(states));
      }
    column = std::move(to);
  };
  by_rank(mind.likely);
  by_rank(mind.probability);
  return mind;
}

}  // namespace

float most_health(const SimSpec& spec) {
  float most = 0;
  for (const AgentSpec& agent : spec.agents) most = std::max(most, agent.max_health);
  return most;
}

void RecordedWorld::note(const SimSpec& spec, const WorldView& w, const RecordedLists& lists, RecordedUnits units) {
  const SimParams& p = spec.params;
  const int n = p.n_agents;
  const auto add_check = [&](const auto* field) {
    check = crc32_of({reinterpret_cast<const char*>(field), static_cast<size_t>(n) * sizeof *field}, check);
  };
  for (const float* field : {w.x, w.y, w.z, w.v, w.heading, w.health}) add_check(field);
  add_check(w.alive);
  map = *w.map;
  if (states == 0)
    for (const float* field : {w.x, w.y, w.z, w.heading, w.v}) start.insert(start.end(), field, field + n);
  for (int i = 0; i < n; ++i) {
    x.push_back(whole_multiple(w.x[i], units.place));
    y.push_back(whole_multiple(w.y[i], units.place));
    z.push_back(whole_multiple(w.z[i], kReplayAltitude));
    heading.push_back(heading_number(w.heading[i]));
    speed.push_back(whole_multiple(w.v[i], kReplaySpeed));
    health.push_back(whole_multiple(w.health[i], units.health));
  }
  over = *w.phase == Phase::waits;
  const auto stat = [&](EpisodeStat s) { return w.stats[static_cast<int>(s)]; };
  if (is_crowd(p)) {
    note_lists(p, w, lists);
  } else {
    note_pairs(p, w);
    note_scores(p, w);
    note_waypoints(p, w);
  }
  if (over) {
    at_time_limit = stat(EpisodeStat::truncated) > 0;
    winner = stat(EpisodeStat::wins_0) > 0   ? ReplayEnd::team_0
             : stat(EpisodeStat::wins_1) > 0 ? ReplayEnd::team_1
                                             : ReplayEnd::tie;
  }
  ++states;
}

void RecordedWorld::note_death(const WorldView& w, int agent, int shooter) {
  const auto k = static_cast<size_t>(agent);
  if (w.alive[agent] || died[k] >= 0) return;
  died[k] = states;
  cause[k] = death_of(w.death[agent]);
  event(ReplayEventKind::death, agent, w.death[agent] == Death::damage ? shooter : -1);
}

void RecordedWorld::note_pairs(const SimParams& p, const WorldView& w) {
  const int n = p.n_agents, words = words_for(n);
  for (int a = 0; a < n; ++a) {
    int shooter = -1;
    for (int b = 0; b < n; ++b) {
      if (team_of(p, a) == team_of(p, b)) {
        // What an agent sees of its own team is whom it hears (rules 6). The dead say nothing of interest.
        if (a != b && n <= kMostListeners && w.alive[a] && bit(w.seen + int64_t{a} * words, b))
          hears.set(pairs.mates(a, b), states);
        continue;
      }
      const int tracked = w.tracked[int64_t{a} * n + b];
      if (tracked > 0) fires.set(pairs.opponents(a, b), states);
      if (tracked > p.min_tracking_time) shooter = b;
      if (!bit(w.detected + int64_t{a} * words, b)) continue;
      sees.set(pairs.opponents(a, b), states);
      if (!std::exchange(contact[team_of(p, b)], true)) event(ReplayEventKind::contact, b, a);
    }
    note_death(w, a, shooter);
  }
}

/// Whom an agent of a crowd sees are the agents of its rows (rules 17.3); the dead listen on, which does not count.
void RecordedWorld::note_lists(const SimParams& p, const WorldView& w, const RecordedLists& lists) {
  for (int b = 0; b < p.n_agents; ++b) {
    const uint32_t* rows = lists.neighbors + int64_t{b} * p.n_neighbors;
    for (int k = 0; w.alive[b] && k < p.n_neighbors; ++k) {
      const auto a = static_cast<int>(rows[k]);
      if (AgentNumber{rows[k]} == kNobody || team_of(p, a) == team_of(p, b) || !w.alive[a]) continue;
      sees.set(a, states);
      if (!std::exchange(contact[team_of(p, b)], true)) event(ReplayEventKind::contact, b, a);
    }
  }
  note_scores(p, w);
  note_waypoints(p, w);
  for (int a = 0; a < p.n_agents; ++a) {
    const uint32_t* entries = lists.fire + int64_t{a} * lists.shooters;
    int shooter = -1;
    for (int k = 0; k < lists.shooters && entries[k] != 0; ++k)
      if (count_of(entries[k]) > p.min_tracking_time) shooter = shooter_of(entries[k]);
    note_fire(a, entries, lists.shooters);
    note_death(w, a, shooter);
  }
}

/// Both lists are ordered by shooter.
void RecordedWorld::note_fire(int target, const uint32_t* entries, int most) {
  std::vector<ReplayFire>& before = burning[static_cast<size_t>(target)];
  std::vector<ReplayFire> now;
  auto old = before.begin();
  const auto end_below = [&](int shooter) {
    for (; old != before.end() && old->shooter < shooter; ++old) fire.push_back(*old);
  };
  for (int k = 0; k < most && entries[k] != 0; ++k) {
    const int shooter = shooter_of(entries[k]);
    end_below(shooter);
    const bool goes_on = old != before.end() && old->shooter == shooter;
    now.push_back(goes_on ? *old++ : ReplayFire{states, states, target, shooter});
    now.back().to = states;
  }
  fire.insert(fire.end(), old, before.end());
  before = std::move(now);
}

void RecordedWorld::note_scores(const SimParams& p, const WorldView& w) {
  const auto stat = [&](EpisodeStat s) { return w.stats[static_cast<int>(s)]; };
  for (int team = 0; team < kNTeams; ++team) {
    const float now = over ? stat(of_team(EpisodeStat::score_0, team)) : w.score[team];
    returns[team] = stat(of_team(EpisodeStat::return_0, team));
    for (int i = 0; now > score[team] && !waypoints.empty() && i < p.n_agents; ++i) {
      const ReplayWaypoint& last = waypoints.back();
      // Who died in this very step may have collected it; under the original rules the dead do, too (rules 15, Q10).
      const int death = died[static_cast<size_t>(i)];
      if (!p.original() && death >= 0 && death < states) continue;
      if (team_of(p, i) != team || w.x[i] < last.x1 || w.x[i] > last.x2 || w.y[i] < last.y1 || w.y[i] > last.y2)
        continue;
      event(ReplayEventKind::collected, i);
      break;
    }
    score[team] = now;
  }
}

void RecordedWorld::note_waypoints(const SimParams& p, const WorldView& w) {
  if (!p.waypoints || !(*w.waypoint_time > 0)) return;
  const float* at = w.waypoint;
  const bool same = !waypoints.empty() && waypoints.back().to == states - 1 && waypoints.back().x1 == at[0] &&
                    waypoints.back().y1 == at[1];
  if (!same) {
    waypoints.push_back({states, states, at[0], at[1], at[2], at[3]});
    event(ReplayEventKind::waypoint);
  }
  waypoints.back().to = states;
}

ReplayEpisode episode_of(const RecordedWorld& w, const SimParams& p, const std::string& seed) {
  const auto n = static_cast<size_t>(p.n_agents);
  const bool discrete = p.actions == ActionKind::discrete;
  GIGA_CHECK(w.over && w.states > 1, "an episode that has not ended");
  const auto states = static_cast<size_t>(w.states);
  ReplayEpisode e;
  e.map = w.map;
  e.steps = w.states - 1;
  e.winner = w.winner;
  e.at_time_limit = w.at_time_limit;
  e.returns = {w.returns[0], w.returns[1]};
  e.score = {w.score[0], w.score[1]};
  e.died = w.died;
  e.cause = w.cause;
  e.events = w.events;
  e.waypoints = w.waypoints;
  e.state_check = w.check;
  e.start = w.start;
  e.x = transposed(w.x, states, n);
  e.y = transposed(w.y, states, n);
  e.z = transposed(w.z, states, n);
  e.heading = transposed(w.heading, states, n);
  e.speed = transposed(w.speed, states, n);
  e.health = transposed(w.health, states, n);
  if (discrete) {
    e.action = transposed(w.action, states - 1, n);
  } else {
    constexpr size_t kSize = kActionSize * sizeof(float);
    e.action.resize(w.action.size());
    for (size_t t = 0; t + 1 < states; ++t)
      for (size_t i = 0; i < n; ++i)
        std::memcpy(e.action.data() + (i * (states - 1) + t) * kSize, w.action.data() + (t * n + i) * kSize, kSize);
  }
  e.sees = w.sees.cut(w.states);
  e.fires = w.fires.cut(w.states);
  e.hears = w.hears.cut(w.states);
  e.fire = w.fire;
  for (const std::vector<ReplayFire>& on : w.burning) e.fire.insert(e.fire.end(), on.begin(), on.end());
  std::sort(e.fire.begin(), e.fire.end(), [](const ReplayFire& a, const ReplayFire& b) {
    return std::tie(a.from, a.target, a.shooter) < std::tie(b.from, b.target, b.shooter);
  });
  for (int team = 0; team < kNTeams; ++team) e.mind[static_cast<size_t>(team)] = mind_of(w, p, team);
  if (!is_crowd(p)) GIGA_CHECK(add_hits(w.pairs, p.min_tracking_time, e), "an episode of millions of hits");
  forget_the_dead(p, e);
  const std::string_view actions(reinterpret_cast<const char*>(e.action.data()), e.action.size());
  e.action_check = crc32_of(actions, crc32_of(seed));
  return e;
}

}  // namespace giga
