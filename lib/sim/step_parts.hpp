// Parts of a step that may be launches of their own: of a world of many agents, which nobody else changes meanwhile.
// What each agent does alone, for itself, waits for nobody, so that its threads are as many as suit it; each launch
// leaves to the next what it needs (leave_grid, hand_on).
#pragma once

#include "sim/step.hpp"

namespace giga {

enum class StepPart {
  play,    ///< the step up to its observation; the whole of it where the episode ended
  move,    ///< up to who has collided
  fight,   ///< who sees and hits whom; no agent waits for another
  settle,  ///< the rest of `play`
  look,    ///< whom each agent sees, and what its row needs; no agent waits for another
  write,   ///< rows; no row waits for another
  observe  ///< all of that by crews, and what agents get for the step (SharedWork::crews_follow): of what else may be
           ///< observed than vectors, `write` follows
};

/// Whether blocks of threads wait for each other in a part. In `observe` those of a block do (reward_block).
constexpr bool blocks_wait(StepPart part) {
  return part == StepPart::play || part == StepPart::move || part == StepPart::settle;
}

/// Runs a part in which no block waits for another, for one world, of n agents, or of none where nothing was left to
/// it. Between two parts all lanes see all results of the first.
template <StepPart part, class Lanes, class DrawsAt>
requires(!blocks_wait(part)) GIGA_HD
    void run_part(const Lanes& waiting, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
                  const StepIo& io, Ending, int64_t world, int n) {
  const auto lanes = without_barrier(waiting);
  if constexpr (part == StepPart::fight) {
    auto&& draws = draws_at(*w.draw_step);
    fight_by_place(lanes, p, w, draws, n, [](int, bool, bool) {});
  }
  if constexpr (part == StepPart::observe) reward_and_add_up(lanes, p, w, io, world, n);
  if constexpr (part == StepPart::look || part == StepPart::observe) {
    auto&& draws = draws_at(*w.draw_step - 1);  // the step has counted itself already
    if constexpr (part == StepPart::look)
      look_and_prepare(lanes, p, w, draws, io, world, false, n);
    else
      look_and_write(lanes, p, w, draws, io, world, n);
  }
  if constexpr (part == StepPart::write) write_rows(lanes, p, w, io, world, n);
}

/// Runs a part in which they do. Whether the world plays it sees for itself.
template <StepPart part, class Lanes, class DrawsAt>
requires(blocks_wait(part)) [[gnu::always_inline]] GIGA_HD
    void run_part(const Lanes& lanes, const Parameters auto& p, World auto& w, const DrawsAt& draws_at,
                  const StepIo& io, Ending ending, int64_t world, int) {
  auto&& draws = draws_at(*w.draw_step);
  if constexpr (part == StepPart::play) step_world(lanes, p, w, draws, io, ending, world);
  if constexpr (part == StepPart::move) {
    const bool active = *w.phase == Phase::plays;
    play_step<Stages::before_fight>(lanes, p, w, draws, io, ending, world, active);
    leave_grid(lanes, w, active);
  }
  if constexpr (part == StepPart::settle) step_world<Stages::after_fight>(lanes, p, w, draws, io, ending, world);
}

}  // namespace giga
