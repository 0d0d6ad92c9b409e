// Encoder: the part of a network between its inputs and its output layer. encoder.cpp has the table of all kinds.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "policy/config.hpp"
#include "policy/layers.hpp"
#include "policy/parameters.hpp"
#include "sim/observation.hpp"

namespace giga {

/// Turns inputs x [..., numbers of the input] into features [..., F]; the numbers of an image lie in a row too. It
/// holds no numbers, the parameters are in a ParameterSet, and remembers nothing (RecurrentCell does).
class Encoder {
 public:
  virtual ~Encoder() = default;
  virtual at::Tensor forward(const ParameterSet& p, at::Tensor x, Rounding rounding) const = 0;
  /// Each member of a population [M, P] on rows of its own: x [M, R, input] -> [M, R, F].
  virtual at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x,
                                     Rounding rounding) const = 0;
  /// F.
  virtual int64_t features() const = 0;
  /// The layers of an encoder that is a chain of dense layers and nothing else. The fused kernels and pages take such
  /// encoders only, and between these layers the agents of a composed critic exchange features. Else empty.
  virtual std::vector<DenseLayer> layers() const { return {}; }
};

/// Makes an encoder, whose parameters are added under `name`/.
using EncoderFactory = std::shared_ptr<const Encoder>(ParameterSet& parameters, const std::string& name,
                                                      const ObservationShape& input, const NetworkConfig& config);
EncoderFactory* encoder_factory(EncoderKind kind);

}  // namespace giga
