#include "policy/layers.hpp"

#include <torch/autograd.h>
#include <torch/types.h>

#include "math/team_mean.hpp"
#include "policy/dense_epilogue.hpp"

namespace giga {

at::Tensor linear(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias) {
  return at::linear(x, weight.to(x.scalar_type()), bias.to(x.scalar_type()));
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
  // A game may write more behind what the network was trained with: then `x` is wider than `columns.row`.
  return x.size(-1) == columns.size ? x : x.narrow(-1, columns.first, columns.size);
}

namespace {

/// Calls LibTorch's vector functions on one thread before anybody else does. On a CPU they are MKL's, which chooses a
/// kernel at the first call. If two threads make that call at the same time, one of them may use another kernel, and
/// its results differ in the last bit. A first tanh on two threads of a Xeon with AVX-512 did so in 28 of 369
/// processes, and in none of 611 after a call like this one.
bool settle_vector_math() {
  const at::Tensor x = at::ones({1});  // too small to be split among threads
  for (const auto function : {at::tanh, at::exp, at::log, at::sqrt, at::erf}) function(x);
  return true;
}

at::Tensor rounded(const at::Tensor& x, Rounding rounding) {
  return rounding == Rounding::to_half ? rounded_to_half(x) : x;
}

}  // namespace

DenseLayer add_dense(ParameterSet& parameters, const std::string& name, const DenseShape& shape) {
  // Every network is made before it computes.
  [[maybe_unused]] static const bool settled = settle_vector_math();
  DenseLayer layer;
  layer.weight = parameters.add(name + "/weight", {shape.output, shape.input}, {Init::Kind::orthogonal, shape.gain});
  layer.bias = parameters.add(name + "/bias", {shape.output}, {Init::Kind::constant, 0});
  if (shape.layer_norm) {
    layer.norm_weight = parameters.add(name + "/norm_weight", {shape.output}, {Init::Kind::constant, 1});
    layer.norm_bias = parameters.add(name + "/norm_bias", {shape.output}, {Init::Kind::constant, 0});
  }
  layer.activation = shape.activation;
  return layer;
}

at::Tensor dense(const ParameterSet& p, const DenseLayer& layer, const at::Tensor& x, Rounding rounding) {
  if (has_fused_epilogue(p, layer, x))
    return dense_epilogue(at::linear(x, p[layer.weight]), p[layer.bias], *layer.activation).features;
  return finish_dense(
      p, layer, linear(rounded(x, rounding), rounded(p[layer.weight], rounding), rounded(p[layer.bias], rounding)));
}

bool has_fused_epilogue(const ParameterSet& p, const DenseLayer& layer, const at::Tensor& x, int64_t n) {
  const at::Tensor& bias = p[layer.bias];
  return x.scalar_type() == at::kBFloat16 && x.numel() > 0 && layer.activation && layer.norm_weight < 0 &&
         dense_epilogue_serves(bias, n);
}

at::Tensor finish_dense(const ParameterSet& p, const DenseLayer& layer, at::Tensor x) {
  if (layer.norm_weight >= 0) {
    const at::Tensor weight = p[layer.norm_weight].to(x.scalar_type()), bias = p[layer.norm_bias].to(x.scalar_type());
    x = at::layer_norm(x, {x.size(-1)}, weight, bias);
  }
  return layer.activation ? activate(x, *layer.activation) : x;
}

at::Tensor dense_members(const ParameterSet& p, const at::Tensor& members, const DenseLayer& layer, const at::Tensor& x,
                         Rounding rounding) {
  const auto of = [&](int k) { return p.of_members(members, k).to(x.scalar_type()); };
  const auto of_features = [&](int k) { return of(k).unsqueeze(1); };  // [M, 1, H]
  at::Tensor y = at::baddbmm(rounded(of_features(layer.bias), rounding), rounded(x, rounding),
                             rounded(of(layer.weight), rounding).transpose(1, 2));
  if (layer.norm_weight >= 0)
    y = at::layer_norm(y, {y.size(-1)}) * of_features(layer.norm_weight) + of_features(layer.norm_bias);
  return layer.activation ? activate(y, *layer.activation) : y;
}

namespace {

// One kernel forward and one backward. Tensor operations would take more time than the layer around the mean: a
// product, a sum and their gradients are one pass over all features each.
struct LivingMeanFunction : torch::autograd::Function<LivingMeanFunction> {
  template <class T>
  static void run(const ParallelFor& parallel_for, const at::Tensor& x, const at::Tensor& alive, at::Tensor& mean) {
    const auto n = static_cast<int>(x.size(1)), width = static_cast<int>(x.size(2));
    parallel_for.run(LivingMean<T>{static_cast<const T*>(x.const_data_ptr()), alive.const_data_ptr<float>(), n, width,
                                   static_cast<T*>(mean.data_ptr())},
                     mean.numel());
  }
  template <class T>
  static void run_gradient(const ParallelFor& parallel_for, const at::Tensor& d_mean, const at::Tensor& alive,
                           at::Tensor& d_x) {
    const auto n = static_cast<int>(d_x.size(1)), width = static_cast<int>(d_x.size(2));
    parallel_for.run(LivingMeanGradient<T>{static_cast<const T*>(d_mean.const_data_ptr()),
                                           alive.const_data_ptr<float>(), n, width, static_cast<T*>(d_x.data_ptr())},
                     d_mean.numel());
  }

  static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& x, const at::Tensor& alive,
                            int64_t parallel_for_address) {
    const auto& parallel_for = *reinterpret_cast<const ParallelFor*>(parallel_for_address);
    context->save_for_backward({alive});
    context->saved_data["parallel_for"] = parallel_for_address;
    at::Tensor mean = at::empty({x.size(0), x.size(2)}, x.options());
    if (x.scalar_type() == at::kBFloat16)
      run<BFloat16>(parallel_for, x, alive, mean);
    else
      run<float>(parallel_for, x, alive, mean);
    return mean;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto& parallel_for = *reinterpret_cast<const ParallelFor*>(context->saved_data["parallel_for"].toInt());
    const at::Tensor alive = context->get_saved_variables()[0], d_mean = gradients[0].contiguous();
    at::Tensor d_x = at::empty({alive.size(0), alive.size(1), d_mean.size(1)}, d_mean.options());
    if (d_mean.scalar_type() == at::kBFloat16)
      run_gradient<BFloat16>(parallel_for, d_mean, alive, d_x);
    else
      run_gradient<float>(parallel_for, d_mean, alive, d_x);
    return {d_x, at::Tensor(), at::Tensor()};
  }
};

}  // namespace

at::Tensor living_mean(const ParallelFor& parallel_for, const at::Tensor& x, const at::Tensor& alive) {
  return LivingMeanFunction::apply(x.contiguous(), alive, reinterpret_cast<int64_t>(&parallel_for));
}

}  // namespace giga
