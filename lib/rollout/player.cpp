#include "rollout/player.hpp"

#include <torch/types.h>

#include "core/error.hpp"
#include "math/distributions.hpp"
#include "policy/actor.hpp"
#include "rollout/tensors.hpp"

namespace giga {

Player player_of(const Actor& actor) { return {&actor}; }

void act(const Player& player, const Simulator& sim, const RowRunner& rows, int team, const ActIo& io) {
  const int n = sim.params().n_team[team];
  const int64_t count = static_cast<int64_t>(sim.n_worlds()) * n;
  const StateView state = sim.state().view();
  GIGA_CHECK(io.obs || !player.looks(), "team ", team, " has no observations to look at");
  const RowDraws draws{state.draw_step, sim.options().seed, sim.options().first_world, n, team};
  if (!player.policy) {
    rows.run(ScriptedActions{player.script, sim.params().actions, draws, state.episode_length, io.action, sim.params(),
                             io.obs, sim.spec().padded_observation_size()},
             count);
    return;
  }
  at::NoGradGuard no_grad;
  const at::Tensor obs = wrap(io.obs, {count, sim.spec().padded_observation_size()}, sim.device());
  const at::Tensor head = player.policy->forward(obs);
  if (sim.params().actions == ActionKind::discrete) {
    rows.run(SampleCategorical{head.const_data_ptr<float>(), draws, static_cast<int32_t*>(io.action), io.log_prob,
                               player.greedy},
             count);
  } else {
    const at::Tensor log_std = player.policy->log_std();
    rows.run(SampleGaussian{head.const_data_ptr<float>(), log_std.const_data_ptr<float>(), draws, io.raw,
                            static_cast<float*>(io.action), io.log_prob, player.greedy},
             count);
  }
}

}  // namespace giga
