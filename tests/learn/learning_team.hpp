// One team that learns against a script, for tests that hold its gradients against LibTorch's.
#pragma once

#include <memory>

#include "learn/mappo/ppo_team.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"

namespace giga::test {

/// Team 0 of a run, which learns, against a script.
struct LearningTeam {
  explicit LearningTeam(const LoadedRun& loaded)
      : run(loaded),
        sim(make_cpu_simulator(run.spec, {run.config.train.n_worlds, 17, 0, OnDone::reset, 1})),
        team(run, 0, Device{}, parallel_for, {{0, sim->n_worlds()}, sim->n_worlds()}),
        collector(*sim, parallel_for,
                  {.horizon = run.config.mappo.horizon,
                   .with_state = team.needs_state(),
                   .desynchronize = true,
                   .keep = team.reads(),
                   .with_final_images = team.critic_reads_image()},
                  {everywhere(policy_controller(team.actor()), *sim),
                   everywhere(script_controller(Scripted::random), *sim)}) {
    collector.start();
  }

  const LoadedRun run;
  const ParallelFor parallel_for{Device{}, 1};
  std::unique_ptr<Simulator> sim;
  PpoTeam team;
  Collector collector;
};

inline at::Tensor saved_as(const NamedArrays& arrays, const char* name, at::IntArrayRef shape) {
  const at::Tensor x = at::empty(shape);
  from_array(find_array(arrays, name), x);
  return x;
}

inline double distance(const at::Tensor& a, const at::Tensor& b) { return ((a - b).norm() / b.norm()).item<double>(); }

}  // namespace giga::test
