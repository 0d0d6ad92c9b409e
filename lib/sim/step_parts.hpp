// The step of a world in parts, each of which may be a launch of its own: what many agents do alone, each for itself,
// then waits for nobody, and its threads are as many as suit it. Together they do what Job::step does (step.hpp).
#pragma once

#include <type_traits>

#include "sim/step.hpp"

namespace giga {

enum class StepPart {
  play,   ///< all that happens, up to what is noted for those who look
  look,   ///< whom each agent sees, and what its row needs; no agent waits for another
  write,  ///< rows; no row waits for another
  settle  ///< what follows where the episode ended (step_settles)
};

/// Runs a part for one world. Between two parts all lanes see all results of the first.
template <StepPart part, class Lanes, class DrawsAt>
GIGA_HD void run_part(const Lanes& lanes, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
                      const StepIo& io, Ending ending, int64_t world) {
  if constexpr (part == StepPart::play) {
    auto&& draws = draws_at(*w.draw_step);
    const bool plays = *w.phase == Phase::plays;
    play_step(lanes, p, w, draws, io, ending.on_done, world, plays);
    mark_agents(lanes, p, w, plays ? p.n_agents : 0);
    return;
  }
  const int n = *w.phase == Phase::waits ? 0 : p.n_agents;  // those of an episode that ended are observed too
  if constexpr (part == StepPart::look) {
    auto&& draws = draws_at(*w.draw_step - 1);  // the step has counted itself already
    look_and_prepare(without_barrier(lanes), p, w, draws, io, world, false, n);
  }
  if constexpr (part == StepPart::write) write_rows(without_barrier(lanes), p, w, io, world, n);
  if constexpr (part == StepPart::settle) {
    if (!to_settle(lanes, w)) return;
    if (ending.on_done == OnDone::freeze) {
      const bool ended = finish_world(lanes, p, w, io, world);
      lanes.each(ended ? 1 : 0, [&](int) { *w.phase = Phase::waits; });
    } else {
      auto&& draws = draws_at(*w.draw_step - 1);
      restart_world(lanes, p, w, draws, io, world);
    }
  }
}

/// Calls f with each part of a step, as a constant, in their order.
template <class F>
void for_each_part(Ending ending, const StepIo& io, F&& f) {
  f(std::integral_constant<StepPart, StepPart::play>{});
  f(std::integral_constant<StepPart, StepPart::look>{});
  f(std::integral_constant<StepPart, StepPart::write>{});
  if (step_settles(ending, io)) f(std::integral_constant<StepPart, StepPart::settle>{});
}

}  // namespace giga
