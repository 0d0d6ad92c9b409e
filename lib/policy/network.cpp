#include "policy/network.hpp"

#include <algorithm>

namespace giga {

Network::Network(ParameterSet& parameters, const std::string& name, const NetworkConfig& config,
                 const NetworkShape& shape)
    : encoder_(encoder_factory(config.encoder)(parameters, name, shape.input, config)) {
  int64_t features = encoder_->features();
  if (config.remembers()) {
    cell_.emplace(parameters, name + "/memory", config.memory, features, config.memory_size);
    features = cell_->features();
  }
  output_ = add_dense(parameters, name + "/" + std::to_string(encoder_->layers().size()),
                      {features, shape.output, shape.output_gain});
}

at::Tensor Network::forward_members(const ParameterSet& p, const at::Tensor& members, const at::Tensor& x,
                                    NetworkState& state, Rounding rounding) const {
  at::Tensor features = encoder_->forward_members(p, members, x, rounding);
  if (cell_) features = cell_->forward_members(p, members, features, state);
  return dense_members(p, members, output_, features, rounding);
}

std::vector<DenseLayer> Network::layers() const {
  std::vector<DenseLayer> layers = encoder_->layers();
  layers.push_back(output_);
  return layers;
}

std::optional<SmallMlp> Network::small(const ParameterSet& p) const {
  const std::vector<DenseLayer> hidden = encoder_->layers();
  if (cell_) return std::nullopt;
  const auto fits = [&](const DenseLayer& layer) {
    return layer.norm_weight < 0 && layer.activation == hidden.front().activation;
  };
  if (hidden.empty() || hidden.size() >= SmallMlp::kMaxLayers || !std::all_of(hidden.begin(), hidden.end(), fits))
    return std::nullopt;
  SmallMlp mlp;
  mlp.activation = hidden.front().activation.value();
  for (const DenseLayer& layer : layers()) {
    const int l = mlp.n_layers++;
    mlp.width[l] = static_cast<int>(p.shape(layer.weight)[1]);
    mlp.width[l + 1] = static_cast<int>(p.shape(layer.weight)[0]);
    mlp.weight[l] = static_cast<int>(p.offset(layer.weight));
    mlp.bias[l] = static_cast<int>(p.offset(layer.bias));
  }
  return mlp;
}

}  // namespace giga
