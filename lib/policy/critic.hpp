// Critic: the value of every agent of a team. Training may show it what no actor sees.
#pragma once

#include <ATen/core/Tensor.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/parallel_for.hpp"
#include "cuda/ppo_gradients.hpp"
#include "policy/inputs.hpp"
#include "policy/network.hpp"
#include "policy/parameters.hpp"
#include "sim/spec.hpp"

namespace giga {

class Actor;

/// Sizes of a critic's inputs.
struct CriticShape {
  int team = 0;
  int n_team[2] = {0, 0};      ///< agents of each team; the state lists team 0 first
  InputColumns inputs;         ///< of observations; the actor's where it shares that one's encoder
  int64_t world_features = 0;  ///< numbers of the state that follow those of the agents (state_observation.hpp)
  int64_t features = 0;        ///< of that encoder; 0: it has one of its own
};

CriticShape critic_shape(const CriticConfig& config, const Actor& actor, const SimSpec& spec, int team);

/// Kind state: the first hidden layer encodes one agent, the others are the value network (or, if there is only one,
/// another one of that size, and the memory).
std::pair<NetworkConfig, NetworkConfig> split_state_critic(const CriticConfig& config);

class Critic {
 public:
  /// `parallel_for` must outlive the critic. `seed`: of its parameters; none: zeros, of one that is loaded.
  Critic(const CriticConfig& config, const CriticShape& shape, Precision precision, const ParallelFor& parallel_for,
         at::Device device, std::optional<uint64_t> seed);

  /// What `forward` takes of observations [B, n, D]: numbers, normalised where the actor normalises them; images; or
  /// the features [B, n, F] of the encoder that the two share.
  at::Tensor input_of(const Actor& actor, const at::Tensor& obs) const;

  /// obs [B, n, D or F] (see input_of), alive [B, n] float, state [B, G] (kind state; else undefined)
  /// -> values [B, n], fp32, in the value normaliser's units. `sequence`: of a critic with memory, which remembers
  /// something of each agent; B = L worlds, and its rows are worlds x n.
  at::Tensor forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state,
                     const Sequence& sequence = {}) const;
  /// Numbers that it remembers of an agent; 0 = no memory.
  int64_t state_size() const { return network_.state_size(); }

  /// As Actor::fused_mlp.
  std::optional<FusedMlp> fused_mlp() const;
  const InputColumns& inputs() const { return shape_.inputs; }

  bool needs_state() const { return kind_ == CriticKind::state; }
  bool shares_encoder() const { return shape_.features > 0; }
  bool reads_image() const { return reads().has(Observation::image); }
  /// What it reads of the agents' observations, by its own encoder or the actor's.
  ObservationSet reads() const { return needs_state() ? ObservationSet() : shape_.inputs.set; }
  ParameterSet& parameters() { return parameters_; }
  const ParameterSet& parameters() const { return parameters_; }
  /// Its parameters from arrays that parameters().save() named. Takes those of a team of one that were saved when such
  /// critics had team weights, too: the values of living agents are the same.
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  void add_team_weights(const std::string& name);
  void put_encoder_before(FusedMlp& mlp) const;
  Rounding rounding() const { return precision_ == Precision::bf16 ? Rounding::to_bfloat16 : Rounding::none; }
  at::Tensor forward_composed(const ParameterSet& p, at::Tensor x, const at::Tensor& alive,
                              const Sequence& sequence) const;
  at::Tensor forward_state(const ParameterSet& p, const at::Tensor& state, const Sequence& sequence) const;

  CriticKind kind_ = CriticKind::composed;
  CriticShape shape_;
  Precision precision_ = Precision::fp32;
  const ParallelFor* parallel_for_ = nullptr;
  ParameterSet parameters_;
  Network network_;                        // kind state: on an agent's code, both teams' means and the world
  std::vector<int> team_weights_;          // composed: by layer; -1 where there is none
  std::shared_ptr<const Encoder> entity_;  // state: encodes one agent
};

}  // namespace giga
