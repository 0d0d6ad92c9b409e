// The one copy of a world's step and reset: the ordered list of stages that every executor runs, and the jobs made of
// them.
#pragma once

#include "sim/communication.hpp"
#include "sim/crew.hpp"
#include "sim/episode.hpp"
#include "sim/movement.hpp"
#include "sim/observations.hpp"
#include "sim/reset.hpp"
#include "sim/rewards.hpp"
#include "sim/schedule.hpp"
#include "sim/sight.hpp"
#include "sim/waypoint.hpp"
#include "sim/world.hpp"

namespace giga {

/// Called where pairs are looked for anew: agents have moved, perhaps without a barrier since each_agent. What keeps
/// pairs in tables has nothing to prepare; a world that finds its pairs by place sorts its agents (grid.hpp).
template <class Lanes>
GIGA_HD void sort_agents(const Lanes&, const Parameters auto&, World auto&, int) {}

/// Called before whom agents see is decided.
template <class Lanes>
GIGA_HD void mark_agents(const Lanes&, const Parameters auto&, World auto&, int) {}

/// lanes.each_agent where each looks for others: in whatever order suits that.
template <class Lanes, class F>
GIGA_HD void each_by_place(const Lanes& lanes, const Parameters auto&, const World auto&, int n, F&& f) {
  lanes.each_agent(n, f);
}

/// The same where several workers may look for an agent together: f(crew, agent, whether the crew has one).
template <class Lanes, class F>
GIGA_HD void each_crew_by_place(const Lanes& lanes, const Parameters auto& p, const World auto& w, int n, F&& f) {
  each_by_place(lanes, p, w, n, [&](int i) { f(OneWorker{}, i, true); });
}

/// Moves agent i as its team's actions say.
GIGA_HD void move_agent(const Parameters auto& p, World auto& w, const StepIo& io, int64_t world, int i) {
  w.was_alive[i] = w.alive[i];
  w.flags[i] = 0;
  w.next[i] = w.x[i];
  w.next[p.n_agents + i] = w.y[i];
  const Controls controls = read_controls(p, io.of(p.team_of(i)), world, team_row(p, world, i));
  const float thrust = table_value(p.agents.thrust + i);
  const Flight to = flown(p, flight_of(w, i), w.was_alive[i] != 0, controls, thrust);
  take_flight(w, to, i);
  if (p.waypoints) touch_waypoint(p, w, i);
  check_bounds(p, w, to, i);
}

/// Collisions, by agents that have moved.
template <class Lanes>
GIGA_HD void check_collisions(const Lanes& lanes, const Parameters auto& p, World auto& w, int n) {
  lanes.each_agent(n, [&](int i) { check_agents(p, w, i); });
  lanes.each_agent(n, [&](int i) { check_obstacles(p, w, i); });
}

/// Counts the living of both teams, before the step and after it. `teams`: 0 where the lanes only keep in step.
template <class Lanes>
GIGA_HD void count_teams(const Lanes& lanes, const Parameters auto& p, World auto& w, int teams) {
  lanes.each(teams, [&](int team) {
    count_team(p, w, w.was_alive, kWasAlive0, team);
    count_team(p, w, w.alive, kAlive0, team);
  });
}

/// Who sees and hits whom, what becomes of them, and how many live then. `teams` as for count_teams.
template <class Lanes, class Draws>
GIGA_HD void fight(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, int n, int teams) {
  each_by_place(lanes, p, w, n, [&](int a) { detect_and_track(p, w, draws, a); });
  lanes.each_agent(n, [&](int i) {
    update_health(p, w, i);
    note_death(w, i);
  });
  count_teams(lanes, p, w, teams);
}

/// What agent i gets for the step.
GIGA_HD void reward_agent(const Parameters auto& p, World auto& w, const StepIo& io, int64_t world, int i) {
  compute_reward(p, w, i);
  float* reward = io.of(p.team_of(i)).reward;
  if (reward) reward[team_row(p, world, i)] = w.reward[i];
  for (int t = 0; io.terms && t < kNRewardTerms; ++t)
    io.terms[(world * kNRewardTerms + t) * p.n_agents + i] =
        term_active(p, static_cast<RewardTerm>(t)) ? w.terms[t * p.n_agents + i] : 0.0f;
}

/// Adds the step to the episode's sums. `items`: n_step_items, or 0.
template <class Lanes>
GIGA_HD void accumulate_step(const Lanes& lanes, const Parameters auto& p, World auto& w, int items) {
  lanes.each(items, [&](int item) { accumulate_episode(p, w, item); });
}

/// Decides whom an agent sees.
template <class Draws>
GIGA_HD void look_around(const Parameters auto& p, World auto& w, Draws& draws, bool after_reset, int e) {
  if (p.stochastic_communication) listen(p, w, draws, e, after_reset);
  look(p, w, e);
}

/// The same and what their rows need, for n agents; nobody waits between the two. What is written of an agent that
/// others may read meanwhile, where it faces (gather_nearest), is what stands there already.
template <WideLanes Lanes, class Draws>
GIGA_HD void look_and_prepare(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws,
                              const StepIo& io, int64_t world, bool after_reset, int n) {
  const bool wanted = wants_rows(io);
  each_crew_by_place(lanes, p, w, n, [&](const auto& crew, int e, bool some) {
    look_around(crew, p, w, draws, after_reset, e, some);
    if (some && crew.leads()) prepare_rows(p, w, io, world, wanted, e);
  });
}

/// The same where all agents have been prepared: each crew writes the vector of its agent.
template <WideLanes Lanes, class Draws>
GIGA_HD void look_and_write(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, const StepIo& io,
                            int64_t world, int n) {
  each_crew_by_place(lanes, p, w, n, [&](const auto& crew, int e, bool some) {
    look_around(crew, p, w, draws, false, e, some);
    float* row = some ? WantedRows<VectorObservation>::row(p, io, world, e) : nullptr;
    VectorObservation::write_by_crew(crew, p, w, e, row);
  });
}

/// Decides what every agent sees and writes it.
template <class Lanes, class Draws>
GIGA_HD void observe_world(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, const StepIo& io,
                           int64_t world, bool after_reset, bool active = true) {
  const int n = active ? p.n_agents : 0;
  mark_agents(lanes, p, w, n);
  if constexpr (WideLanes<Lanes>) {
    look_and_prepare(lanes, p, w, draws, io, world, after_reset, n);
    write_rows(lanes, p, w, io, world, n);
  } else {
    each_by_place(lanes, p, w, n, [&](int e) { look_around(p, w, draws, after_reset, e); });
    write_observations(lanes, p, w, io, world, active);
  }
}

/// Starts an episode. `active` as for write_observations.
template <class Lanes, class Draws>
GIGA_HD void reset_world(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws,
                         bool active = true) {
  const int n = active ? p.n_agents : 0, one = active ? 1 : 0;
  lanes.each(one, [&](int) { begin_episode(p, w, draws); });
  lanes.each_agent(n, [&](int i) { place_agent(p, w, draws, i); });
  for (int round = 1; round <= kResampleRounds; ++round) {
    sort_agents(lanes, p, w, n);
    lanes.each_agent(n, [&](int i) { propose_place(p, w, draws, round, i); });
    lanes.each_agent(n, [&](int i) { accept_place(p, w, i); });
  }
  sort_agents(lanes, p, w, n);
  // The original's first observation shows no opponent even where everything is observable (Q18).
  if (!p.original() && !p.stochastic_detection && !p.stochastic_communication)
    each_by_place(lanes, p, w, n, [&](int a) { detect_only(p, w, draws, a); });
}

/// Stages of a step up to its observation: all, or those before the fight and those after it, where the fight is a
/// launch of its own (step_parts.hpp).
enum class Stages { all, before_fight, after_fight };

/// The stages of one step of one world, up to its observation. Between two stages all lanes see all results of the
/// first, but where the first is one without_barrier. Where the episode ends, its world is left in Phase::terminated or
/// truncated. `active`: it plays. Returns whether nothing is left to do here: launches that follow observe the world
/// (step_parts.hpp), or know that it waits. One function for all of them: cut in three, which the compiler put together
/// again, kernels of small worlds had other registers and spilled more.
template <Stages stages, class Lanes, class Draws>
GIGA_HD bool play_step(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, const StepIo& io,
                       Ending ending, int64_t world, bool active) {
  const int n = active ? p.n_agents : 0, one = active ? 1 : 0, teams = active ? kNTeams : 0;
  bool handed_on = false;
  [[maybe_unused]] const int length = WideLanes<Lanes> ? *w.episode_length + 1 : 0;  // before anybody counts it

  if constexpr (stages != Stages::after_fight) {
    without_barrier(lanes).each_agent(n, [&](int i) {  // sorting begins with the same agents
      move_agent(p, w, io, world, i);
    });
    sort_agents(lanes, p, w, n);
    check_collisions(lanes, p, w, n);
    if (p.waypoints) lanes.each(one, [&](int) { update_waypoint(p, w, draws); });
  }
  if constexpr (stages == Stages::before_fight) return handed_on;
  if constexpr (stages == Stages::all) fight(lanes, p, w, draws, n, teams);
  if constexpr (stages == Stages::after_fight) count_living(lanes, p, w, n);
  without_barrier(lanes).each(one, [&](int) { end_of_step(p, w); });  // no reward asks for what it writes
  if constexpr (WideLanes<Lanes>) {
    const bool gone0 = w.counts[kAlive0] == 0, gone1 = w.counts[kAlive1] == 0;
    const bool ended = active && ending.on_done != OnDone::keep && done_after(p, gone0, gone1, length) != Done::running;
    handed_on = hand_on(lanes, p, w, io, world, n, ended && step_settles(ending, io));
    if (!handed_on || !hands_on_rewards(w)) reward_and_accumulate(lanes, p, w, io, world, n);
  } else {
    lanes.each_agent(n, [&](int i) { reward_agent(p, w, io, world, i); });
    accumulate_step(lanes, p, w, active ? n_step_items(p) : 0);
  }

  without_barrier(lanes).each(1, [&](int) {  // it is observed next, which asks for nothing of this
    const Done done = active ? static_cast<Done>(w.counts[kDone]) : Done::running;
    if (io.done) io.done[world] = static_cast<uint8_t>(done);
    if (done != Done::running && ending.on_done != OnDone::keep)
      *w.phase = done == Done::terminated ? Phase::terminated : Phase::truncated;
    if (active) *w.draw_step += 1;
  });
  // A world that waits earns nothing.
  lanes.each_agent(active ? 0 : p.n_agents, [&](int i) {
    float* reward = io.of(p.team_of(i)).reward;
    if (reward) reward[team_row(p, world, i)] = 0.0f;
  });
  return handed_on;
}

/// Whether the step ended the episode and its last observation is wanted.
GIGA_HD bool keeps_final(const World auto& w, const StepIo& io) {
  return *w.phase == Phase::truncated || (*w.phase == Phase::terminated && !io.final_of_truncations_only);
}

/// Whether any world that shares these lanes has an episode to settle.
template <class Lanes>
GIGA_HD bool to_settle(const Lanes& lanes, const World auto& w) {
  return lanes.any(*w.phase == Phase::terminated || *w.phase == Phase::truncated);
}

/// Where the episode ended: adds it to the statistics and keeps its last observation. Returns whether it did.
template <class Lanes>
GIGA_HD bool finish_world(const Lanes& lanes, const Parameters auto& p, World auto& w, const StepIo& io,
                          int64_t world) {
  const bool ended = *w.phase == Phase::terminated || *w.phase == Phase::truncated;
  lanes.wait_delivered();  // the rows of the last observation
  lanes.each(ended ? kNEpisodeItems : 0, [&](int item) { finish_episode(p, w, item); });
  keep_final(lanes, p, io, world, keeps_final(w, io));
  return ended;
}

/// One step of one world, or its stages after the fight, and what it observes then. Where the episode ended and the
/// step settles that (step_settles): with OnDone::freeze the world waits, with OnDone::reset a new episode starts, by
/// the draws of this step, and is observed. Where launches follow, they may observe it (play_step). A loop around the
/// one call that observes: twice that code would not fit into the GPU's instruction cache. Always inlined: as a
/// function of its own it would reach all that a world has through a pointer.
template <Stages stages = Stages::all, class Lanes, class Draws>
[[gnu::always_inline]] GIGA_HD void step_world(const Lanes& lanes, const Parameters auto& p, World auto& w,
                                               Draws& draws, const StepIo& io, Ending ending, int64_t world) {
  bool observes = *w.phase == Phase::plays, restarted = false;
  if (play_step<stages>(lanes, p, w, draws, io, ending, world, observes)) return;
  GIGA_ROLLED
  for (;;) {
    observe_world(lanes, p, w, draws, io, world, restarted, observes);
    if (restarted || !step_settles(ending, io) || !to_settle(lanes, w)) return;
    observes = finish_world(lanes, p, w, io, world);
    if (ending.on_done == OnDone::freeze) {
      lanes.each(observes ? 1 : 0, [&](int) { *w.phase = Phase::waits; });
      return;
    }
    reset_world(lanes, p, w, draws, observes);
    restarted = true;
  }
}

/// What step_world does where an episode ended, for a step that did not settle it: OnDone::reset, after the last images
/// were drawn.
template <class Lanes, class Draws>
GIGA_HD void restart_world(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, const StepIo& io,
                           int64_t world) {
  const bool ended = finish_world(lanes, p, w, io, world);
  reset_world(lanes, p, w, draws, ended);
  observe_world(lanes, p, w, draws, io, world, true, ended);
}

/// What follows a step in which the episode ended, with OnDone::freeze and several episodes: the world plays its next
/// one, or waits if it has played them all. Each episode has max_episode_length + 2 steps of the draws for itself, so
/// that worlds that draw the same numbers do so however long their episodes were; `draws_at(step)` makes them. A pass
/// of its own, because it is rare.
template <class Lanes, class DrawsAt>
GIGA_HD void play_on(const Lanes& lanes, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
                     const StepIo& io, int64_t world, int episodes) {
  // The step has counted itself already, and so did the start.
  const uint32_t step = *w.draw_step + static_cast<uint32_t>(p.max_episode_length + 1 - *w.episode_length);
  const bool ended = finish_world(lanes, p, w, io, world);
  const bool more = ended && w.stats[static_cast<int>(EpisodeStat::episodes)] < static_cast<float>(episodes);
  lanes.each(ended ? 1 : 0, [&](int) {
    if (more)
      *w.draw_step = step + 1;
    else
      *w.phase = Phase::waits;
  });
  auto&& draws = draws_at(step);
  reset_world(lanes, p, w, draws, more);
  observe_world(lanes, p, w, draws, io, world, true, more);
}

/// The first episode of a world: everything zero but the reward factor, then a reset and the first observation.
template <class Lanes, class Draws>
GIGA_HD void start_world(const Lanes& lanes, const Parameters auto& p, World auto& w, Draws& draws, const StepIo& io,
                         int64_t world) {
  lanes.each(1, [&](int) {
    *w.reward_factor = 1.0f;
    for (int team = 0; team < kNTeams; ++team) w.returns[team] = w.returns_masked[team] = w.score[team] = 0;
    for (int k = 0; k < kNTeams * kNRewardTerms; ++k) w.term_returns[k] = 0;
    for (int k = 0; k < kNStatRows; ++k) w.stats[k] = 0;
  });
  reset_world(lanes, p, w, draws);
  observe_world(lanes, p, w, draws, io, world, true);
  lanes.each(1, [&](int) { *w.draw_step += 1; });
}

/// Whether a job has anything to do in any world that shares these lanes; asked before the job.
template <Job job, class Lanes>
GIGA_HD bool has_work(const Lanes& lanes, const World auto& w) {
  if constexpr (job == Job::restart || job == Job::play_on || job == Job::draw_final) return to_settle(lanes, w);
  return true;
}

/// Runs a job for one world, where it has work. `draws_at(step)` makes the draws of a step. Always inlined, as
/// step_world.
template <Job job, class Lanes, class DrawsAt>
[[gnu::always_inline]] GIGA_HD void run_job(const Lanes& lanes, const Parameters auto& p, World auto& w,
                                            const DrawsAt& draws_at, const StepIo& io, Ending ending, int64_t world) {
  if constexpr (job == Job::start) {
    auto&& draws = draws_at(*w.draw_step);
    start_world(lanes, p, w, draws, io, world);
  }
  if constexpr (job == Job::step) {
    auto&& draws = draws_at(*w.draw_step);
    step_world(lanes, p, w, draws, io, ending, world);
  }
  if constexpr (job == Job::restart) {
    auto&& draws = draws_at(*w.draw_step - 1);  // the step's own: it has counted itself already
    restart_world(lanes, p, w, draws, io, world);
  }
  if constexpr (job == Job::play_on) play_on(lanes, p, w, draws_at, io, world, ending.episodes);
  // Every world, those that wait too: the buffers need not hold what was written before.
  if constexpr (job == Job::observe) write_observations(lanes, p, w, io, world);
  if constexpr (job == Job::draw || job == Job::draw_final) {
    const bool final = job == Job::draw_final;
    if (!final || keeps_final(w, io)) draw_images(lanes, p, w, io, world, final, marks_of(w));
  }
}

/// All jobs of a call for one world, for executors whose workers see to one world at a time.
template <class Lanes, class DrawsAt>
void run_jobs(const Lanes& lanes, const Jobs& jobs, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
              const StepIo& io, Ending ending, int64_t world) {
  for (const Job job : jobs)
    with_job(job, [&](auto constant) {
      constexpr Job kJob = decltype(constant)::value;
      if (has_work<kJob>(lanes, w)) run_job<kJob>(lanes, p, w, draws_at, io, ending, world);
    });
}

}  // namespace giga
