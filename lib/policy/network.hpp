// Network: an encoder and the output layer on its features.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "math/small_mlp.hpp"
#include "policy/encoder.hpp"

namespace giga {

/// What a network is made with.
struct NetworkShape {
  ObservationShape input;
  int64_t output;
  float output_gain;                  ///< of the initialisation of the output layer
  EncoderFactory* encoder = nullptr;  ///< null: that of the table for NetworkConfig::encoder
};

class Network {
 public:
  Network() = default;
  /// The parameters are added under `name`/.
  Network(ParameterSet& parameters, const std::string& name, const NetworkConfig& config, const NetworkShape& shape);

  /// x [..., input] -> [..., output].
  at::Tensor forward(const ParameterSet& p, const at::Tensor& x, NetworkState& state,
                     Rounding rounding = Rounding::none) const {
    return dense(p, output_, encoder_->forward(p, x, state, rounding), rounding);
  }
  /// Each member of a population [M, P] on rows of its own: x [M, R, input] -> [M, R, output].
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, const at::Tensor& x, NetworkState& state,
                             Rounding rounding) const {
    return dense_members(p, members, output_, encoder_->forward_members(p, members, x, state, rounding), rounding);
  }

  const Encoder& encoder() const { return *encoder_; }
  /// Those that the encoder lists, then the output layer.
  std::vector<DenseLayer> layers() const;
  /// The layout for the fused kernel. None where that has no room for it (layer normalisation, many or wide layers), or
  /// the encoder is no chain of dense layers.
  std::optional<SmallMlp> small(const ParameterSet& p) const;

 private:
  std::shared_ptr<const Encoder> encoder_;
  DenseLayer output_;
};

}  // namespace giga
