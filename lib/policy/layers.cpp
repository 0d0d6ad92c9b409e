#include "policy/layers.hpp"

#include <torch/autograd.h>
#include <torch/types.h>

#include "math/team_mean.hpp"

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

at::Tensor rounded_to_half(const at::Tensor& x) { return x.to(at::kHalf).to(at::kFloat); }

at::Tensor columns_of(const InputColumns& columns, const at::Tensor& x) {
  return columns.all() ? x : x.narrow(-1, columns.first, columns.size);
}

namespace {

/// Calls LibTorch's vector functions for the first time in this process, on one thread. On a CPU they are MKL's, which
/// choose their kernel at the first call; where two threads make that call together, one of them may compute its share
/// with another kernel, whose results differ in the last bit. A first tanh on two threads of a Xeon with AVX-512 did so
/// in 28 of 369 processes, and in none of 611 after a call like this one.
bool settle_vector_math() {
  const at::Tensor x = at::ones({1});  // too small to be split among threads
  for (const auto function : {at::tanh, at::exp, at::log, at::sqrt, at::erf}) function(x);
  return true;
}

}  // namespace

Mlp::Mlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config, int64_t output,
         float output_gain)
    : config_(config) {
  // Whoever computes with networks makes one first.
  [[maybe_unused]] static const bool settled = settle_vector_math();
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

namespace {
at::Tensor rounded(const at::Tensor& x, Rounding rounding) {
  return rounding == Rounding::to_half ? rounded_to_half(x) : x;
}
}  // namespace

at::Tensor Mlp::forward(const ParameterSet& p, at::Tensor x, Rounding rounding) const {
  const auto product = [&](const Layer& layer) {
    return linear(rounded(x, rounding), rounded(p[layer.weight], rounding), rounded(p[layer.bias], rounding));
  };
  for (const Layer& layer : layers_) x = finish(p, layer, product(layer));
  return x;
}

at::Tensor Mlp::forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x,
                                Rounding rounding) const {
  const auto of = [&](int k) { return p.of_members(members, k).to(x.scalar_type()); };
  const auto of_features = [&](int k) { return of(k).unsqueeze(1); };  // [M, 1, H]
  for (const Layer& layer : layers_) {
    x = at::baddbmm(rounded(of_features(layer.bias), rounding), rounded(x, rounding),
                    rounded(of(layer.weight), rounding).transpose(1, 2));
    if (!layer.hidden) continue;
    if (layer.norm_weight >= 0)
      x = at::layer_norm(x, {x.size(-1)}) * of_features(layer.norm_weight) + of_features(layer.norm_bias);
    x = activate(x, config_.activation);
  }
  return x;
}

std::optional<SmallMlp> Mlp::small(const ParameterSet& p) const {
  if (config_.layer_norm || !SmallMlp::has_room_for(config_.hidden)) return std::nullopt;
  SmallMlp mlp;
  mlp.activation = config_.activation;
  for (const Layer& layer : layers_) {
    const int l = mlp.n_layers++;
    mlp.width[l] = static_cast<int>(p.shape(layer.weight)[1]);
    mlp.width[l + 1] = static_cast<int>(p.shape(layer.weight)[0]);
    mlp.weight[l] = static_cast<int>(p.offset(layer.weight));
    mlp.bias[l] = static_cast<int>(p.offset(layer.bias));
  }
  return mlp;
}

namespace {

// One kernel each way. With tensor operations the mean costs more time than the layer around it: a product, a sum and
// their gradients, each a pass over all features.
struct LivingMeanFunction : torch::autograd::Function<LivingMeanFunction> {
  template <class T>
  static void run(const ParallelFor& rows, const at::Tensor& x, const at::Tensor& alive, at::Tensor& mean) {
    const auto n = static_cast<int>(x.size(1)), width = static_cast<int>(x.size(2));
    rows.run(LivingMean<T>{static_cast<const T*>(x.const_data_ptr()), alive.const_data_ptr<float>(), n, width,
                           static_cast<T*>(mean.data_ptr())},
             mean.numel());
  }
  template <class T>
  static void run_gradient(const ParallelFor& rows, const at::Tensor& d_mean, const at::Tensor& alive,
                           at::Tensor& d_x) {
    const auto n = static_cast<int>(d_x.size(1)), width = static_cast<int>(d_x.size(2));
    rows.run(LivingMeanGradient<T>{static_cast<const T*>(d_mean.const_data_ptr()), alive.const_data_ptr<float>(), n,
                                   width, static_cast<T*>(d_x.data_ptr())},
             d_mean.numel());
  }

  static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& x, const at::Tensor& alive,
                            int64_t rows_address) {
    const auto& rows = *reinterpret_cast<const ParallelFor*>(rows_address);
    context->save_for_backward({alive});
    context->saved_data["rows"] = rows_address;
    at::Tensor mean = at::empty({x.size(0), x.size(2)}, x.options());
    if (x.scalar_type() == at::kBFloat16)
      run<BFloat16>(rows, x, alive, mean);
    else
      run<float>(rows, x, alive, mean);
    return mean;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto& rows = *reinterpret_cast<const ParallelFor*>(context->saved_data["rows"].toInt());
    const at::Tensor alive = context->get_saved_variables()[0], d_mean = gradients[0].contiguous();
    at::Tensor d_x = at::empty({alive.size(0), alive.size(1), d_mean.size(1)}, d_mean.options());
    if (d_mean.scalar_type() == at::kBFloat16)
      run_gradient<BFloat16>(rows, d_mean, alive, d_x);
    else
      run_gradient<float>(rows, d_mean, alive, d_x);
    return {d_x, at::Tensor(), at::Tensor()};
  }
};

}  // namespace

at::Tensor living_mean(const ParallelFor& rows, const at::Tensor& x, const at::Tensor& alive) {
  return LivingMeanFunction::apply(x.contiguous(), alive, reinterpret_cast<int64_t>(&rows));
}

TeamMlp::TeamMlp(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config,
                 int64_t output, float output_gain)
    : own_(parameters, name, input, config, output, output_gain) {
  team_weights_.push_back(-1);
  for (size_t k = 1; k < own_.layers_.size(); ++k)
    team_weights_.push_back(parameters.add_beside(
        own_.layers_[k].weight, name + "/" + std::to_string(k) + "/team_weight", config.hidden[k - 1]));
}

at::Tensor TeamMlp::forward(const ParameterSet& p, const ParallelFor& rows, at::Tensor x,
                            const at::Tensor& alive) const {
  const int64_t b = x.size(0), n = x.size(1);
  for (size_t k = 0; k < own_.layers_.size(); ++k) {
    const auto& layer = own_.layers_[k];
    at::Tensor y = linear(x.reshape({b * n, x.size(-1)}), p[layer.weight], p[layer.bias]).view({b, n, -1});
    if (team_weights_[k] >= 0) {
      const at::Tensor weight = p[team_weights_[k]].to(x.scalar_type());
      y = y + at::mm(living_mean(rows, x, alive), weight.t()).unsqueeze(1);
    }
    x = own_.finish(p, layer, y);
  }
  return x;
}

}  // namespace giga
