#include "rollout/shapes.hpp"

#include "sim/row_layout.hpp"

namespace giga {

RolloutShapes rollout_shapes(const SimSpec& spec, const RolloutSize& size) {
  const int64_t t = size.horizon, w = size.n_worlds, d = observation_rows(spec).stride(), g = spec.state_size();
  const bool discrete = spec.params.actions == ActionKind::discrete;
  RolloutShapes shapes;
  for (size_t team = 0; team < kNTeams; ++team) {
    TeamRolloutShapes& s = shapes.team[team];
    const int64_t n = spec.params.n_team[team];
    if (discrete)
      s.action = {ElementType::i32, {t, w, n}};
    else
      s.action = {ElementType::f32, {t, w, n, kActionSize}};
    if (size.team[team] == BufferSet::observations) s.obs = {ElementType::f32, {1, w, n, d}};
    if (size.team[team] != BufferSet::learning) continue;
    s.obs = {ElementType::f32, {t + 1, w, n, d}};
    s.alive = {ElementType::u8, {t + 1, w, n}};
    if (!discrete) s.pre_tanh_action = {ElementType::f32, {t, w, n, kActionSize}};
    s.log_prob = s.reward = {ElementType::f32, {t, w, n}};
    s.final_obs = {ElementType::f32, {w, n, d}};
    s.final_alive = {ElementType::u8, {w, n}};
  }
  shapes.done = {ElementType::u8, {t, w}};
  if (size.with_state) {
    shapes.true_state = {ElementType::f32, {t + 1, w, g}};
    shapes.final_true_state = {ElementType::f32, {w, g}};
  }
  return shapes;
}

}  // namespace giga
