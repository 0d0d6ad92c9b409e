// Critic: the value of every agent of a team, from what training may know (the actors see only their observations).
#pragma once

#include <ATen/core/Tensor.h>

#include <string>
#include <utility>

#include "core/parallel_for.hpp"
#include "policy/inputs.hpp"
#include "policy/layers.hpp"
#include "policy/normalizer.hpp"
#include "policy/parameters.hpp"
#include "sim/params.hpp"

namespace giga {

/// Sizes of what a critic reads.
struct CriticShape {
  int team = 0;
  int n_team[2] = {0, 0};      ///< agents of each team; the state lists team 0 first
  InputColumns inputs;         ///< of observations
  int64_t world_features = 0;  ///< numbers of the state behind the agents' (state_encoding.hpp)
};

CriticShape critic_shape(const CriticConfig& config, const SimSpec& spec, int team);

/// Kind state: the encoder of one agent has the first hidden layer, the value network the others (or, where there is
/// one only, another of that size).
std::pair<MlpConfig, MlpConfig> split_state_critic(const CriticConfig& config);

class Critic {
 public:
  /// `rows` must outlive the critic.
  Critic(const CriticConfig& config, const CriticShape& shape, Precision precision, const ParallelFor& rows,
         at::Device device, uint64_t seed);

  /// Number of parameters of such a critic; nothing is allocated.
  static int64_t count_parameters(const CriticConfig& config, const CriticShape& shape);

  /// obs [B, n, D] (already normalised where the actor does), alive [B, n] float, state [B, G] (kind state; else
  /// undefined) -> values [B, n], fp32, in the value normaliser's units.
  at::Tensor forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state) const;

  bool needs_state() const { return kind_ == CriticKind::state; }
  ParameterSet& parameters() { return parameters_; }
  const ParameterSet& parameters() const { return parameters_; }

 private:
  Critic() = default;
  void add_parameters(const CriticConfig& config, const CriticShape& shape);
  at::Tensor forward_state(const at::Tensor& state) const;

  CriticKind kind_ = CriticKind::composed;
  CriticShape shape_;
  Precision precision_ = Precision::fp32;
  const ParallelFor* rows_ = nullptr;
  ParameterSet parameters_;
  Mlp mlp_;           // independent: on observations; state: on an agent's encoding, both teams' means and the world
  TeamMlp team_mlp_;  // composed
  Mlp entity_;        // state: encodes one agent
};

}  // namespace giga
