// PolicyModel: a policy as plain data: its architecture and the tensors of it, over observations without padding. What
// every export format is written from.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/named_array.hpp"
#include "export/image_encoder.hpp"
#include "export/row_view.hpp"
#include "policy/config.hpp"
#include "sim/params.hpp"

namespace giga {

/// Which tensors a policy has follows from this.
struct PolicyShape {
  int inputs = 0;  ///< numbers that the network reads, bytes of an image included
  ActionKind actions = ActionKind::discrete;
  MlpConfig network;                     ///< hidden sizes, activation, layer_norm
  bool normalizes = false;               ///< observations pass (x - mean) / std first, clamped to +- kNormalizedLimit
  MemoryKind memory = MemoryKind::none;  ///< between the hidden layers and the last one
  int memory_size = 0;                   ///< H; 0 without memory
  /// The policy takes the vector observation alone, and computes the egocentric view behind it; none: it takes what the
  /// network reads.
  std::optional<RowView> view = {};
  /// The encoder of a policy that takes an image [side, side, 3] of bytes, before its dense layers; side 0: it takes
  /// numbers.
  ImageEncoderShape image = {};

  bool reads_image() const { return image.side > 0; }
  /// Numbers of an observation.
  int row() const { return view ? view->row_size() : inputs; }
  /// Logits of the actions, or means before squashing.
  int outputs() const { return actions == ActionKind::discrete ? kNDiscreteActions : kActionSize; }
  /// "logits" or "mean".
  const char* output_name() const { return actions == ActionKind::discrete ? "logits" : "mean"; }
  int n_layers() const { return static_cast<int>(network.hidden.size()) + 1; }
  /// Numbers that a row remembers: H, of an LSTM 2 H (h, then c).
  int state_size() const { return memory == MemoryKind::lstm ? 2 * memory_size : memory_size; }
  bool is_hidden(int layer) const { return layer + 1 < n_layers(); }
};

/// All tensors are fp32. Those of the convolutions of an encoder of images (image_encoder.hpp); observation.mean and
/// observation.std [inputs] (where it normalises); per layer K layers.K.weight [to, from], layers.K.bias [to], and of
/// hidden ones with layer_norm layers.K.norm_weight and layers.K.norm_bias [to]; with memory those of a RecurrentCell,
/// as memory.input_weight and so on; log_std [3] (continuous actions).
struct PolicyModel {
  PolicyShape shape;
  NamedArrays tensors;
};

/// "layers.2.weight".
std::string layer_tensor(int layer, const char* part);
constexpr const char *kInputWeightTensor = "memory.input_weight", *kInputBiasTensor = "memory.input_bias",
                     *kHiddenWeightTensor = "memory.hidden_weight", *kHiddenBiasTensor = "memory.hidden_bias";
constexpr const char *kMeanTensor = "observation.mean", *kStdTensor = "observation.std", *kLogStdTensor = "log_std";

struct TensorShape {
  std::string name;
  std::vector<int64_t> shape;
};
std::vector<TensorShape> tensors_of(const PolicyShape& shape);

/// Throws InputError where a model has not exactly the tensors of its shape, a number is not finite or a deviation not
/// positive; `source` is the file that it is from.
void check_tensors(const PolicyModel& model, const std::string& source);

}  // namespace giga
