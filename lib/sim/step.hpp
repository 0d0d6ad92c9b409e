// The one copy of a world's step and reset: the ordered list of stages that every executor runs.
#pragma once

#include "sim/movement.hpp"
#include "sim/observe.hpp"
#include "sim/reset.hpp"
#include "sim/rewards.hpp"
#include "sim/sight.hpp"
#include "sim/state_encoding.hpp"
#include "sim/waypoint.hpp"
#include "sim/world.hpp"

namespace giga {

/// Row of agent i in its team's buffers.
GIGA_HD int64_t team_row(const SimParams& p, int64_t world, int i) {
  return world * p.n_team[p.team_of(i)] + p.agents.slot[i];
}

/// Where observations of a world go: the running ones, or those of an episode that has just ended.
struct ObservationSink {
  float* obs[kNTeams];      // [W, n, D]
  uint8_t* alive[kNTeams];  // [W, n]
  float* global;            // [W, G]
  int stride;               // see StepIo::obs_stride
};
GIGA_HD ObservationSink running_sink(const StepIo& io) {
  return {{io.team[0].obs, io.team[1].obs}, {io.team[0].alive, io.team[1].alive}, io.global, io.obs_stride};
}
GIGA_HD ObservationSink final_sink(const StepIo& io) {
  return {{io.team[0].final_obs, io.team[1].final_obs},
          {io.team[0].final_alive, io.team[1].final_alive},
          io.final_global,
          io.obs_stride};
}

/// Writes what every agent sees, by w.seen. `active` false keeps the lanes in lockstep without work.
template <class Lanes>
GIGA_HD void write_observations(const Lanes& lanes, const SimParams& p, WorldView& w, const ObservationSink& sink,
                                int64_t world, bool active = true) {
  const int n = active ? p.n_agents : 0;
  lanes.each(n, [&](int e) {
    rank_neighbors(p, w, e);
    uint8_t* alive = sink.alive[p.team_of(e)];
    if (alive) alive[team_row(p, world, e)] = w.alive[e];
  });
  const int columns = observation_size(p), stride = sink.stride > 0 ? sink.stride : columns;
  if (sink.obs[0] || sink.obs[1])
    lanes.each_cell(n, columns, [&](int e, int column) {
      float* obs = sink.obs[p.team_of(e)];
      if (obs) obs[team_row(p, world, e) * stride + column] = observation_value(p, w, e, column);
    });
  const int state_columns = active && sink.global ? global_size(p) : 0;
  lanes.each(state_columns, [&](int k) { sink.global[world * state_columns + k] = global_value(p, w, k); });
}

/// Decides what every agent sees and writes it.
template <class Lanes, class Draws>
GIGA_HD void observe_world(const Lanes& lanes, const SimParams& p, WorldView& w, Draws& draws,
                           const ObservationSink& sink, int64_t world, bool after_reset, bool active = true) {
  const int n = active ? p.n_agents : 0;
  if (p.stochastic_communication) lanes.each(n, [&](int e) { listen(p, w, draws, e, after_reset); });
  lanes.each(n, [&](int e) { look(p, w, e); });
  write_observations(lanes, p, w, sink, world, active);
}

/// Starts an episode. `active` as above.
template <class Lanes, class Draws>
GIGA_HD void reset_world(const Lanes& lanes, const SimParams& p, WorldView& w, Draws& draws, bool active = true) {
  const int n = active ? p.n_agents : 0, one = active ? 1 : 0;
  lanes.each(one, [&](int) { begin_episode(p, w, draws); });
  lanes.each(n, [&](int i) { place_agent(p, w, draws, i); });
  for (int round = 1; round <= kResampleRounds; ++round) {
    lanes.each(n, [&](int i) { propose_place(p, w, draws, round, i); });
    lanes.each(n, [&](int i) { accept_place(p, w, i); });
  }
  // The original's first observation shows no opponent even where everything is observable (Q18).
  if (!p.original() && !p.stochastic_detection && !p.stochastic_communication)
    lanes.each(n, [&](int a) { detect_only(p, w, draws, a); });
}

/// One step of one world. Between two stages all lanes see all results of the first.
template <class Lanes, class Draws>
GIGA_HD void step_world(const Lanes& lanes, const SimParams& p, WorldView& w, Draws& draws, const StepIo& io,
                        OnDone on_done, int64_t world) {
  const bool active = !*w.finished;
  const int n = active ? p.n_agents : 0, one = active ? 1 : 0, teams = active ? kNTeams : 0;

  lanes.each(n, [&](int i) {
    w.was_alive[i] = w.alive[i];
    w.flags[i] = 0;
    const void* action = io.team[p.team_of(i)].action;
    move(p, w, read_controls(p, action, team_row(p, world, i)), i);
    if (p.waypoints) touch_waypoint(p, w, i);
    check_bounds(p, w, i);
  });
  lanes.each(n, [&](int i) { check_agents(p, w, i); });
  lanes.each(n, [&](int i) { check_obstacles(p, w, i); });
  if (p.waypoints) lanes.each(one, [&](int) { update_waypoint(p, w, draws); });
  lanes.each(n, [&](int a) { detect_and_track(p, w, draws, a); });
  lanes.each(n, [&](int i) { update_health(p, w, i); });
  lanes.each(teams, [&](int team) {
    count_team(p, w, w.was_alive, kWasAlive0, team);
    count_team(p, w, w.alive, kAlive0, team);
  });
  lanes.each(one, [&](int) { end_of_step(p, w); });
  lanes.each(n, [&](int i) {
    compute_reward(p, w, i);
    float* reward = io.team[p.team_of(i)].reward;
    if (reward) reward[team_row(p, world, i)] = w.reward[i];
    for (int t = 0; io.terms && t < kNRewardTerms; ++t)
      io.terms[(world * kNRewardTerms + t) * p.n_agents + i] =
          term_active(p, static_cast<RewardTerm>(t)) ? w.terms[t * p.n_agents + i] : 0.0f;
  });
  lanes.each(active ? kNBookItems : 0, [&](int item) { keep_books(p, w, item); });

  const bool ended = active && w.counts[kDone] != static_cast<int32_t>(Done::running);
  const bool resets = ended && on_done == OnDone::reset;
  lanes.each(1, [&](int) {
    if (io.done) io.done[world] = active ? static_cast<uint8_t>(w.counts[kDone]) : static_cast<uint8_t>(Done::running);
    if (ended && on_done == OnDone::freeze) *w.finished = 1;
  });
  // A world that waits earns nothing.
  lanes.each(active ? 0 : p.n_agents, [&](int i) {
    float* reward = io.team[p.team_of(i)].reward;
    if (reward) reward[team_row(p, world, i)] = 0.0f;
  });

  if (on_done != OnDone::keep && lanes.any(ended)) {
    lanes.each(ended ? kNBookItems : 0, [&](int item) { close_books(w, item); });
    if (io.team[0].final_obs || io.team[1].final_obs || io.final_global)
      observe_world(lanes, p, w, draws, final_sink(io), world, false, ended);
    if (on_done == OnDone::reset) reset_world(lanes, p, w, draws, resets);
  }
  observe_world(lanes, p, w, draws, running_sink(io), world, resets);
  lanes.each(one, [&](int) { *w.draw_step += 1; });
}

/// The first episode of a world: everything zero but the reward factor, then a reset and the first observation.
template <class Lanes, class Draws>
GIGA_HD void start_world(const Lanes& lanes, const SimParams& p, WorldView& w, Draws& draws, const StepIo& io,
                         int64_t world) {
  lanes.each(1, [&](int) {
    *w.reward_factor = 1.0f;
    for (int team = 0; team < kNTeams; ++team) w.returns[team] = w.returns_masked[team] = w.score[team] = 0;
    for (int k = 0; k < kNTeams * kNRewardTerms; ++k) w.term_returns[k] = 0;
    for (int k = 0; k < kNStatRows; ++k) w.stats[k] = 0;
  });
  reset_world(lanes, p, w, draws);
  observe_world(lanes, p, w, draws, running_sink(io), world, true);
  lanes.each(1, [&](int) { *w.draw_step += 1; });
}

}  // namespace giga
