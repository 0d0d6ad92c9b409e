// Parts of a step that may be launches of their own, after the one that plays it: what many agents do alone, each for
// itself, then waits for nobody, and its threads are as many as suit it. The launch before has left to them what they
// need (hand_on), or has seen to the world itself, where the episode ended.
#pragma once

#include "sim/step.hpp"

namespace giga {

enum class StepPart {
  look,             ///< whom each agent sees, and what its row needs; no agent waits for another
  write,            ///< rows; no row waits for another
  look_and_reward,  ///< look, and what agents get for the step, in its first sums (hands_on_rewards)
  write_and_add_up  ///< write, and the sums of these, of at most kSumBlock blocks a team: more need a barrier
};

/// Runs a part for one world, of n agents, or of none where nothing was left to it. Between two parts all lanes see all
/// results of the first.
template <StepPart part, class Lanes, class DrawsAt>
GIGA_HD void run_part(const Lanes& waiting, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
                      const StepIo& io, int64_t world, int n) {
  const auto lanes = without_barrier(waiting);
  if constexpr (part == StepPart::look_and_reward) reward_blocks(lanes, p, w, io, world, n);
  if constexpr (part == StepPart::look || part == StepPart::look_and_reward) {
    auto&& draws = draws_at(*w.draw_step - 1);  // the step has counted itself already
    look_and_prepare(lanes, p, w, draws, io, world, false, n);
  } else {
    write_rows(lanes, p, w, io, world, n);
  }
  if constexpr (part == StepPart::write_and_add_up) add_up_blocks(lanes, p, w, n);
}

}  // namespace giga
