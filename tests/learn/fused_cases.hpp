// What the tests of the fused update share: cases, each with networks and a rollout, and what a step needs.
#pragma once

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <string>
#include <vector>

#include "learn/mappo/config.hpp"
#include "learn/mappo/fused_update.hpp"
#include "policy/optimizer.hpp"
#include "rollout/tensors.hpp"
#include "runs.hpp"

namespace giga::test {

constexpr Device kOneGpu{Device::Kind::cuda, 0};
constexpr float kNoClip = 10, kClip = 0.2f, kEntropyCoef = 0.05f, kValueCoef = 0.5f, kMaxNorm = 0.1f;

struct FusedCase {
  const char* name;
  ActionKind actions;
  CriticKind critic;
  Activation activation;
  std::vector<int> hidden;
  int n;               // agents
  int columns, first;  // numbers that the networks read, from this one on
  bool normalize;
  AdvantageNorm norm;
  float clip = kNoClip;
  int64_t n_states = 600;  // of the rollout, of which every third is learned from
  // Of the games' true states:
  int n_other = 2, team = 0;            // agents of the other team; the own one
  int world = 7;                        // numbers of the world
  std::vector<int> critic_hidden = {};  // none: as the actor's
};

/// They cover activations, kinds of actions and critics, and sizes of layers, inputs and teams.
const std::vector<FusedCase>& fused_cases();

Critic make_critic(const FusedCase& c, const ParallelFor& parallel_for, Device device);

/// Networks of a case, whose parameters are those of the initialisation plus normal numbers, and a rollout.
struct FusedSetting {
  static constexpr int64_t kRow = 200;
  const int64_t n_states;
  const ActionKind actions;
  ParallelFor parallel_for;
  Actor actor;
  Critic critic;
  at::Tensor obs, true_state, alive, states, action, u, log_prob, advantage, old_value, returns, mean, std,
      entropy_coef, clip_coef;

  FusedSetting(const FusedCase& c, Device device, int n_threads = 2);
  /// The rows of the states that are learned from.
  at::Tensor pick(const at::Tensor& x) const { return x.index_select(0, states); }
  FusedInputs inputs() const { return {obs, true_state}; }
  /// What the critic reads.
  at::Tensor seen() const { return critic.needs_state() ? true_state : obs; }
  /// What the losses take of the rollout.
  FusedPolicyLoss policy_loss() const;  // with kEntropyCoef and the clip of the case
  FusedValueLoss value_loss() const;
};

/// What a step needs besides the gradients: optimizers, flags and figures of its own.
struct FusedSteps {
  Adam adam[2];
  at::Tensor figures, stop, number, step_size;

  explicit FusedSteps(const FusedSetting& s, float rate = 0)
      : adam{{s.actor.parameters(), 1e-5f}, {s.critic.parameters(), 1e-5f}},
        figures(at::zeros({kNFigures}, s.obs.options())),
        stop(at::zeros({1}, s.obs.options())),
        number(at::ones({1}, s.obs.options())),
        step_size(at::full({1}, rate, s.obs.options())) {}
  StepFlags flags(int network) const;
  FusedStep of(const FusedSetting& s) const;
};

/// The tests with each case on a CPU, and on a GPU.
class LearnFusedUpdate : public testing::TestWithParam<FusedCase> {};
class LearnFusedUpdateGpu : public LearnFusedUpdate {};

/// Empty if a GPU can run the kernels; else why not.
std::string no_fused_kernels();

}  // namespace giga::test
