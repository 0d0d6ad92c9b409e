// Network: an encoder, a memory where it has one, and the output layer.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "math/small_mlp.hpp"
#include "policy/encoder.hpp"
#include "policy/network_state.hpp"
#include "policy/recurrent_cell.hpp"

namespace giga {

/// What a network is made with.
struct NetworkShape {
  ObservationShape input;
  int64_t output;
  float output_gain;  ///< of the initialisation of the output layer
};

class Network {
 public:
  Network() = default;
  /// The parameters are added under `name`/.
  Network(ParameterSet& parameters, const std::string& name, const NetworkConfig& config, const NetworkShape& shape);

  /// x [..., input] -> [..., output]; with a memory x [L R, input], and `sequence` says what is remembered.
  at::Tensor forward(const ParameterSet& p, const at::Tensor& x, const Sequence& sequence,
                     Rounding rounding = Rounding::none) const {
    return behind_encoder(p, encoder_->forward(p, x, rounding), sequence, rounding);
  }
  /// The rest of the way: features [..., F] -> [..., output].
  at::Tensor behind_encoder(const ParameterSet& p, const at::Tensor& features, const Sequence& sequence,
                            Rounding rounding = Rounding::none) const {
    return dense(p, output_, remember(p, features, sequence), rounding);
  }
  /// One step of each member of a population [M, P] on rows of its own: x [M, R, input] -> [M, R, output].
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, const at::Tensor& x, NetworkState& state,
                             Rounding rounding) const;
  /// From features to what the output layer reads: the features themselves, where there is no memory.
  at::Tensor remember(const ParameterSet& p, const at::Tensor& features, const Sequence& sequence) const {
    return cell_ ? cell_->forward(p, features, sequence) : features;
  }
  /// Numbers that a row remembers; 0 = no memory.
  int64_t state_size() const { return cell_ ? cell_->state_size() : 0; }

  const Encoder& encoder() const { return *encoder_; }
  /// Those that the encoder lists, then the output layer.
  std::vector<DenseLayer> layers() const;
  /// The layout for the fused kernels. None where they know no such network (layer normalisation, many layers, a
  /// memory), or the encoder is no chain of dense layers.
  std::optional<SmallMlp> small(const ParameterSet& p) const;

 private:
  std::shared_ptr<const Encoder> encoder_;
  std::optional<RecurrentCell> cell_;  // none: it remembers nothing
  DenseLayer output_;
};

}  // namespace giga
