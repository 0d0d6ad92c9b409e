#include "rollout/player.hpp"

#include <torch/types.h>

#include "core/error.hpp"
#include "math/distributions.hpp"
#include "math/population_actions.hpp"
#include "policy/actor.hpp"
#include "rollout/group_policy.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// The buffers from a world on.
ActIo from_world(const ActIo& io, const Simulator& sim, int n, int64_t world) {
  const int64_t row = world * n;
  const bool discrete = sim.params().actions == ActionKind::discrete;
  const int64_t action_bytes = discrete ? int64_t{sizeof(int32_t)} : kActionSize * int64_t{sizeof(float)};
  return {io.obs ? io.obs + row * sim.spec().padded_observation_size() : nullptr,
          static_cast<char*>(io.action) + row * action_bytes, io.raw ? io.raw + row * kActionSize : nullptr,
          io.log_prob ? io.log_prob + row : nullptr, io.state};
}

/// How the agents of a team act in some worlds.
struct Acting {
  const Simulator& sim;
  const RowRunner& rows;
  RowDraws draws;
  ActIo io;  // from the first of the worlds on
  int64_t worlds;

  int64_t count() const { return worlds * draws.n; }
  at::Tensor obs() const { return wrap(io.obs, {count(), sim.spec().padded_observation_size()}, sim.device()); }
};

void run_script(Scripted script, const Acting& a, const int32_t* episode_length) {
  a.rows.run(ScriptedActions{script, a.sim.params().actions, a.draws, episode_length, a.io.action, a.sim.params(),
                             a.io.obs, a.sim.spec().padded_observation_size()},
             a.count());
}

void run_groups(const GroupPolicy& policy, bool greedy, const Acting& a) {
  GIGA_CHECK(a.worlds % policy.groups() == 0, a.worlds, " worlds for ", policy.groups(), " groups");
  const at::Tensor head = policy.forward(a.obs());
  const bool continuous = policy.actions() == ActionKind::continuous;
  a.rows.run(PopulationActions{{policy.actions(), greedy, a.draws, a.io.action},
                               head.const_data_ptr<float>(),
                               static_cast<int>(policy.head_size()),
                               policy.rows().const_data_ptr<float>(),
                               policy.rows().size(1),
                               continuous ? policy.log_std_offset() : 0,
                               nullptr,
                               a.worlds / policy.groups()},
             a.count());
}

void run_policy(const Policy& policy, bool greedy, const Acting& a) {
  at::NoGradGuard no_grad;
  GIGA_CHECK(a.io.state || policy.state_size() == 0, "nobody keeps what this policy remembers");
  const at::Tensor head = a.io.state ? policy.forward(a.obs(), *a.io.state) : policy.forward(a.obs());
  if (a.sim.params().actions == ActionKind::discrete) {
    a.rows.run(SampleCategorical{head.const_data_ptr<float>(), a.draws, static_cast<int32_t*>(a.io.action),
                                 a.io.log_prob, greedy},
               a.count());
  } else {
    const at::Tensor log_std = policy.log_std();
    a.rows.run(SampleGaussian{head.const_data_ptr<float>(), log_std.const_data_ptr<float>(), a.draws, a.io.raw,
                              static_cast<float*>(a.io.action), a.io.log_prob, greedy},
               a.count());
  }
}

}  // namespace

Player player_of(const Actor& actor) { return {&actor}; }

void act(const Player& player, const Simulator& sim, const RowRunner& rows, int team, const ActIo& io,
         const WorldRange& worlds) {
  GIGA_CHECK(io.obs || !player.looks(), "team ", team, " has no observations to look at");
  const int n = sim.params().n_team[team];
  const StateView state = sim.state().view();
  const RowDraws draws{state.draw_step + worlds.first, sim.options().seed, sim.options().first_world + worlds.first, n,
                       team};
  const Acting acting{sim, rows, draws, from_world(io, sim, n, worlds.first), worlds.count};
  if (player.policy) {
    run_policy(*player.policy, player.greedy, acting);
  } else if (player.groups) {
    run_groups(*player.groups, player.greedy, acting);
  } else {
    run_script(player.script, acting, state.episode_length + worlds.first);
  }
}

}  // namespace giga
