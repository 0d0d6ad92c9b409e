// The encoder `mlp`: input -> hidden ... -> hidden, with the activation after each layer.
#include "policy/encoder.hpp"

namespace giga {
namespace {

class Mlp final : public Encoder {
 public:
  Mlp(ParameterSet& parameters, const std::string& name, const ObservationShape& input_shape, const MlpConfig& config)
      : features_(config.hidden.back()) {
    int64_t input = input_shape.size();
    for (const int size : config.hidden) {
      const DenseShape shape{input, size, config.hidden_gain, config.activation, config.layer_norm};
      layers_.push_back(add_dense(parameters, name + "/" + std::to_string(layers_.size()), shape));
      input = size;
    }
  }

  at::Tensor forward(const ParameterSet& p, at::Tensor x, Rounding rounding) const override {
    for (const DenseLayer& layer : layers_) x = dense(p, layer, x, rounding);
    return x;
  }
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x,
                             Rounding rounding) const override {
    for (const DenseLayer& layer : layers_) x = dense_members(p, members, layer, x, rounding);
    return x;
  }
  int64_t features() const override { return features_; }
  std::vector<DenseLayer> layers() const override { return layers_; }

 private:
  int64_t features_;
  std::vector<DenseLayer> layers_;
};

}  // namespace

std::shared_ptr<const Encoder> make_mlp(ParameterSet& parameters, const std::string& name,
                                        const ObservationShape& input, const NetworkConfig& config) {
  return std::make_shared<Mlp>(parameters, name, input, config);
}

}  // namespace giga
