// PlainNetwork: the forward pass of a policy without LibTorch, one agent at a time. tests/play holds it to LibTorch's.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "math/activation.hpp"
#include "sim/params.hpp"

namespace giga {

/// activation(norm(x W^T + b)), as policy/layers.hpp has it.
struct PlainLayer {
  std::optional<Activation> activation;       ///< none in the output layer
  std::vector<float> weight, bias;            ///< [output, input], [output]
  std::vector<float> norm_weight, norm_bias;  ///< [output] each; empty without layer normalisation

  size_t outputs() const { return bias.size(); }
  size_t inputs() const { return weight.size() / bias.size(); }
};

/// A recurrent cell between the hidden layers and the last one, as policy/recurrent_cell.hpp has it. G gates: three are
/// those of a GRU, four those of an LSTM.
struct PlainMemory {
  std::vector<float> input_weight, input_bias;    ///< [G H, F], [G H]; all are empty in networks without memory
  std::vector<float> hidden_weight, hidden_bias;  ///< [G H, H], [G H]

  size_t size() const { return hidden_bias.empty() ? 0 : hidden_weight.size() / hidden_bias.size(); }  ///< H
  bool is_lstm() const { return hidden_bias.size() == 4 * size(); }
  /// Numbers that a row remembers: H, of an LSTM the H of its cell too.
  size_t state_size() const { return is_lstm() ? 2 * size() : size(); }
};

struct PlainNetwork {
  ActionKind actions = ActionKind::discrete;
  bool greedy = false;           ///< takes its most likely action instead of drawing one
  bool half = false;             ///< weights and what a layer takes in are rounded to half precision
  std::vector<float> mean, std;  ///< [inputs] of the normaliser; empty: there is none
  std::vector<PlainLayer> layers;
  PlainMemory memory;
  std::vector<float> log_std;  ///< [3]; continuous actions only

  size_t inputs() const { return layers.front().inputs(); }
  /// `row`: the first inputs() numbers of an agent's observations -> `head`: 27 logits, or 3 means before squashing.
  /// `state`: memory.state_size() numbers that the agent remembers, zeros where an episode begins; becomes those after
  /// this step.
  void forward(const float* row, float* state, float* head) const;
};

/// The nearest number of half precision, halves to even; infinite beyond 65,504.
float rounded_to_half_precision(float x);

/// For a page's module, which has read_network.
std::string network_bytes(const PlainNetwork& network);
PlainNetwork read_network(std::string_view bytes);

}  // namespace giga
