#include "policy/network.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga {

Network::Network(ParameterSet& parameters, const std::string& name, const NetworkConfig& config,
                 const NetworkShape& shape)
    : encoder_(
          (shape.encoder ? shape.encoder : encoder_factory(config.encoder))(parameters, name, shape.input, config)),
      output_(add_dense(parameters, name + "/" + std::to_string(encoder_->layers().size()),
                        {encoder_->features(), shape.output, shape.output_gain})) {
  GIGA_CHECK(shape.encoder || has_memory(config.encoder) == (encoder_->state_size() > 0),
             "has_memory() of the encoder");
}

std::vector<DenseLayer> Network::layers() const {
  std::vector<DenseLayer> layers = encoder_->layers();
  layers.push_back(output_);
  return layers;
}

std::optional<SmallMlp> Network::small(const ParameterSet& p) const {
  const std::vector<DenseLayer> hidden = encoder_->layers();
  std::vector<int> sizes;
  for (const DenseLayer& layer : hidden) sizes.push_back(static_cast<int>(p.shape(layer.weight)[0]));
  const auto fits = [&](const DenseLayer& layer) {
    return layer.norm_weight < 0 && layer.activation == hidden.front().activation;
  };
  if (hidden.empty() || !std::all_of(hidden.begin(), hidden.end(), fits) || !SmallMlp::has_room_for(sizes))
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
