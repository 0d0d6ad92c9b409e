// What LibTorch allocates while the networks of policy/ run forward and backward: their steps, with bytes for numbers.
// A change of the order or the kind of operations there belongs here too; tests/learn/memory_plan_test.cpp notices.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "learn/memory/ledger.hpp"
#include "policy/config.hpp"
#include "policy/critic.hpp"
#include "sim/state_encoding.hpp"

namespace giga {

/// An Mlp or a TeamMlp at work on some rows. Whatever is held is booked under the use `kept`, gradients as temporary.
class MlpMemory {
 public:
  struct Shape {
    int64_t input = 0, output = 0;  ///< output 0: the last hidden features are the result
    int64_t rows = 0;
    int64_t states = 0;         ///< TeamMlp: rows / agents; Mlp: 0
    int64_t element_bytes = 4;  ///< 2 in bf16
    bool rounds = false;        ///< fp16: layers round what they multiply; `infer` only
  };
  MlpMemory(MemoryLedger& ledger, MemoryUse kept, const MlpConfig& config, const Shape& shape);

  int64_t output_bytes() const { return rows_of(layers_.back().out); }
  /// Whether the backward pass needs the output: tanh and relu do at the end of a network without an output layer.
  bool keeps_output() const { return layers_.back().hidden && !keeps_input_of_activation(); }

  /// Without gradients. Ends with the output held; the input is the caller's.
  void infer();
  /// Likewise Mlp::forward_members: the rows are shared out among so many sets of parameters.
  void infer_members(int64_t members);
  /// Ends with the output held, and what the backward pass needs.
  void forward();
  /// Gives back what was kept, and ends with the gradient of the input held where asked for; returns its bytes. The
  /// output where it is not kept, and its gradient, are the caller's.
  int64_t backward(bool input_gradient);

 private:
  struct Layer {
    int64_t in, out;
    bool hidden, team;  // team: it also gets the team's mean
  };
  int64_t rows_of(int64_t width) const { return shape_.element_bytes * shape_.rows * width; }
  int64_t states_of(int64_t width) const { return shape_.element_bytes * shape_.states * width; }
  int64_t statistics_bytes() const { return 8 * shape_.rows; }  // of a layer norm: mean and deviation of each row
  int64_t weight_copy_bytes(const Layer& l) const { return shape_.element_bytes == 2 ? 2 * l.in * l.out : 0; }
  int64_t weight_gradient_bytes(const Layer& l) const { return weight_copy_bytes(l) + 4 * l.in * l.out; }
  bool keeps_input_of_activation() const {
    return config_.activation == Activation::silu || config_.activation == Activation::gelu;
  }
  void linear(const Layer& layer);
  int64_t rounded_bytes(const Layer& layer) const;
  void team_mean_backward(const Layer& layer);

  MemoryLedger& ledger_;
  const MemoryUse kept_;
  const MlpConfig config_;
  const Shape shape_;
  std::vector<Layer> layers_;
};

/// A Critic at work on some states. Observations and who lives are the caller's.
class CriticMemory {
 public:
  struct Size {
    int64_t states = 0;
    int64_t element_bytes = 4;  ///< 2 in bf16
  };
  CriticMemory(MemoryLedger& ledger, MemoryUse kept, const CriticConfig& config, const CriticShape& shape,
               const Size& size);

  /// Values without gradients, of the caller's true state where the critic reads it.
  void infer();
  /// Values, their loss, and the way back; the true state is gathered for the way there.
  void learn();

 private:
  int64_t own() const { return shape_.n_team[shape_.team]; }
  int64_t n_agents() const { return shape_.n_team[0] + shape_.n_team[1]; }
  int64_t largest_team() const { return std::max(own(), n_agents() - own()); }
  int64_t per_state(int64_t width) const { return size_.element_bytes * size_.states * width; }
  int64_t values_bytes() const { return 4 * size_.states * own(); }
  int64_t value_input_bytes() const { return per_state(own() * (3 * code_ + shape_.world_features)); }
  /// Observations in bf16; without that the network reads the caller's.
  int64_t cast_bytes() const { return size_.element_bytes == 2 ? per_state(own() * shape_.inputs.size) : 0; }
  int64_t state_bytes() const { return 4 * size_.states * (n_agents() * kEntityFeatures + shape_.world_features); }
  int64_t living_bytes() const { return 4 * size_.states * n_agents(); }  // by team, for its mean
  int64_t cast_of_values() const { return size_.element_bytes == 2 ? values_bytes() / 2 : 0; }
  int64_t join_codes();
  void join_codes_backward(int64_t gradient);

  MemoryLedger& ledger_;
  const MemoryUse kept_;
  const CriticConfig config_;
  const CriticShape shape_;
  const Size size_;
  int64_t code_ = 0;                 // width of an agent's code; kind state only, as the next
  std::optional<MlpMemory> entity_;  // encodes agents
  std::optional<MlpMemory> value_;
};

}  // namespace giga
