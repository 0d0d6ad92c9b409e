#include "policy/layers.hpp"

#include <ATen/ATen.h>

namespace giga {

at::Tensor linear(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias) {
  if (x.scalar_type() == at::kBFloat16) return at::linear(x, weight.to(at::kBFloat16), bias.to(at::kBFloat16));
  return at::linear(x, weight, bias);
}

at::Tensor activate(const at::Tensor& x, Activation activation) {
  switch (activation) {
    case Activation::tanh:
      return at::tanh(x);
    case Activation::relu:
      return at::relu(x);
    case Activation::silu:
      return at::silu(x);
    case Activation::gelu:
      return at::gelu(x);
  }
  return x;
}

Mlp::Mlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config, int64_t output,
         float output_gain)
    : config_(config) {
  const auto add = [&](int64_t from, int64_t to, float gain, bool hidden) {
    const std::string at = name + "/" + std::to_string(layers_.size());
    Layer layer{};
    layer.weight = parameters.add(at + "/weight", {to, from}, {Init::Kind::orthogonal, gain});
    layer.bias = parameters.add(at + "/bias", {to}, {Init::Kind::constant, 0});
    layer.hidden = hidden;
    if (hidden && config.layer_norm) {
      layer.norm_weight = parameters.add(at + "/norm_weight", {to}, {Init::Kind::constant, 1});
      layer.norm_bias = parameters.add(at + "/norm_bias", {to}, {Init::Kind::constant, 0});
    } else {
      layer.norm_weight = layer.norm_bias = -1;
    }
    layers_.push_back(layer);
  };
  int64_t from = input;
  for (const int size : config.hidden) {
    add(from, size, config.hidden_gain, true);
    from = size;
  }
  if (output > 0) add(from, output, output_gain, false);
}

at::Tensor Mlp::finish(const ParameterSet& p, const Layer& layer, at::Tensor x) const {
  if (!layer.hidden) return x;
  if (layer.norm_weight >= 0) {
    const at::Tensor weight = p[layer.norm_weight].to(x.scalar_type()), bias = p[layer.norm_bias].to(x.scalar_type());
    x = at::layer_norm(x, {x.size(-1)}, weight, bias);
  }
  return activate(x, config_.activation);
}

at::Tensor Mlp::forward(const ParameterSet& p, at::Tensor x) const {
  for (const Layer& layer : layers_) x = finish(p, layer, linear(x, p[layer.weight], p[layer.bias]));
  return x;
}

at::Tensor living_mean(const at::Tensor& x, const at::Tensor& alive) {
  // A sum of products rather than a batched matrix product: the matrices are tiny, and cuBLAS is slow at millions of them.
  return (x * (alive / alive.sum(1, true).clamp_min(1))).sum(1, true);
}

TeamMlp::TeamMlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config,
                 int64_t output, float output_gain)
    : own_(parameters, name, input, config, output, output_gain) {
  team_weights_.push_back(-1);
  for (size_t k = 1; k < own_.layers_.size(); ++k) {
    const int64_t from = config.hidden[k - 1], to = k < config.hidden.size() ? config.hidden[k] : output;
    const float gain = k < config.hidden.size() ? config.hidden_gain : output_gain;
    team_weights_.push_back(parameters.add(name + "/" + std::to_string(k) + "/team_weight", {to, from},
                                           {Init::Kind::orthogonal, gain}));
  }
}

at::Tensor TeamMlp::forward(const ParameterSet& p, at::Tensor x, const at::Tensor& alive) const {
  const int64_t b = x.size(0), n = x.size(1);
  const at::Tensor mask = alive.to(x.scalar_type());
  for (size_t k = 0; k < own_.layers_.size(); ++k) {
    const auto& layer = own_.layers_[k];
    at::Tensor y = linear(x.reshape({b * n, x.size(-1)}), p[layer.weight], p[layer.bias]).view({b, n, -1});
    if (team_weights_[k] >= 0) {
      const at::Tensor weight = p[team_weights_[k]].to(x.scalar_type());
      y = y + at::matmul(living_mean(x, mask), weight.t());
    }
    x = own_.finish(p, layer, y);
  }
  return x;
}

}  // namespace giga
