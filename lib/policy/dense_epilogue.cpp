#include "policy/dense_epilogue.hpp"

#include <torch/autograd.h>
#include <torch/types.h>

#include <algorithm>
#include <optional>

#include "core/error.hpp"
#include "math/dense_epilogue.hpp"
#include "policy/run_elementwise.hpp"

namespace giga {
namespace {

constexpr int64_t kMostRowsOfState = 64;
constexpr int64_t kRowsWithoutTeam = 4;  // of a thread: as many as of the usual team

/// Whether a thread may read eight columns at once.
bool aligned(const at::Tensor& x) {
  return reinterpret_cast<uintptr_t>(x.const_data_ptr()) % sizeof(EightColumns) == 0;
}
at::Tensor readable(const at::Tensor& x) {
  if (!x.defined()) return x;
  const at::Tensor rows = x.contiguous();
  return aligned(rows) ? rows : rows.clone();
}
BFloat16* rounded_numbers(const at::Tensor& x) { return x.defined() ? static_cast<BFloat16*>(x.data_ptr()) : nullptr; }
const float* exact_numbers(const at::Tensor& x) { return x.defined() ? x.const_data_ptr<float>() : nullptr; }
LayerRows rows_of(const at::Tensor& x, int64_t n) {
  const int64_t columns = x.size(-1);
  return {.rows = x.numel() / columns, .columns = static_cast<int>(columns), .n = static_cast<int>(n)};
}
/// Of the bias gradient: as many threads as fill a GPU, but each with four states, if there are so many. What they
/// leave is then small beside what they read.
int parts_of(const LayerRows& layer) {
  constexpr int64_t kThreads = int64_t{1} << 17, kStates = 4;
  return static_cast<int>(
      std::clamp<int64_t>(layer.states() / kStates, 1, std::max<int64_t>(1, kThreads / layer.across())));
}

struct EpilogueFunction : torch::autograd::Function<EpilogueFunction> {
  static torch::autograd::variable_list forward(torch::autograd::AutogradContext* context, const at::Tensor& sums,
                                                const at::Tensor& bias, const std::optional<at::Tensor>& of_team,
                                                const std::optional<at::Tensor>& alive, int64_t n, int64_t activation,
                                                bool differentiable) {
    const LayerRows layer = rows_of(sums, n);
    const auto kind = static_cast<Activation>(activation);
    const at::Tensor output = at::empty_like(sums), team = of_team.value_or(at::Tensor()),
                     living = alive.value_or(at::Tensor());
    const at::Tensor slopes = differentiable && !output_tells_slope(kind) ? at::empty_like(sums) : at::Tensor();
    const at::Tensor mean =
        living.defined() ? at::empty({layer.states(), layer.columns}, sums.options()) : at::Tensor();
    run_elementwise(sums,
                    DenseEpilogue{.layer = layer,
                                  .activation = kind,
                                  .sums = rounded_numbers(sums),
                                  .bias = rounded_numbers(bias),
                                  .of_team = rounded_numbers(team),
                                  .alive = exact_numbers(living),
                                  .output = rounded_numbers(output),
                                  .slopes = rounded_numbers(slopes),
                                  .mean = rounded_numbers(mean)},
                    layer.states() * layer.across());
    context->set_materialize_grads(false);
    context->save_for_backward({slopes.defined() ? slopes : output, living});
    context->saved_data["n"] = n;
    context->saved_data["activation"] = activation;
    context->saved_data["team"] = team.defined();
    if (mean.defined()) return {output, mean};
    return {output};
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 const torch::autograd::variable_list& gradients) {
    const torch::autograd::variable_list saved = context->get_saved_variables();
    const at::Tensor kept = saved[0], living = saved[1];
    const at::Tensor d_output = readable(gradients[0]),
                     d_mean = gradients.size() > 1 ? readable(gradients[1]) : at::Tensor();
    const LayerRows layer = rows_of(kept, context->saved_data["n"].toInt());
    const int parts = parts_of(layer);
    const at::Tensor d_sums = at::empty_like(kept);
    const at::Tensor d_bias = at::empty({parts, layer.columns}, kept.options().dtype(at::kFloat));
    const at::Tensor d_team = context->saved_data["team"].toBool()
                                  ? at::empty({layer.states(), layer.columns}, kept.options())
                                  : at::Tensor();
    run_elementwise(
        kept,
        DenseEpilogueGradient{.layer = layer,
                              .activation = static_cast<Activation>(context->saved_data["activation"].toInt()),
                              .parts = parts,
                              .kept = rounded_numbers(kept),
                              .d_output = rounded_numbers(d_output),
                              .d_mean = rounded_numbers(d_mean),
                              .alive = d_mean.defined() ? exact_numbers(living) : nullptr,
                              .d_sums = rounded_numbers(d_sums),
                              .d_of_team = rounded_numbers(d_team),
                              .d_bias = d_bias.data_ptr<float>()},
        int64_t{parts} * layer.across());
    return {d_sums, d_bias.sum(0).to(at::kBFloat16), d_team, at::Tensor(), at::Tensor(), at::Tensor(), at::Tensor()};
  }
};

std::optional<at::Tensor> if_any(const at::Tensor& x) {
  return x.defined() ? std::optional(readable(x)) : std::nullopt;
}

}  // namespace

bool dense_epilogue_serves(const at::Tensor& bias, int64_t n) {
  return bias.is_cuda() && bias.scalar_type() == at::kBFloat16 && bias.size(0) % EightColumns::kSize == 0 &&
         aligned(bias) && n <= kMostRowsOfState;
}

LayerFeatures dense_epilogue(const at::Tensor& sums, const at::Tensor& bias, Activation activation,
                             const SharedByTeam& team) {
  const int64_t columns = sums.size(-1), rows = sums.numel() / columns, states = rows / team.n;
  GIGA_CHECK(columns % EightColumns::kSize == 0 && bias.numel() == columns && aligned(bias), columns, " columns");
  GIGA_CHECK(states * team.n == rows && (!team.alive.defined() || team.alive.numel() == rows) &&
                 (!team.of_team.defined() || team.of_team.numel() == states * columns),
             rows, " rows of states of ", team.n);
  const bool alone = !team.of_team.defined() && !team.alive.defined();
  const bool differentiable = at::GradMode::is_enabled() && (sums.requires_grad() || bias.requires_grad() ||
                                                             (team.of_team.defined() && team.of_team.requires_grad()));
  const torch::autograd::variable_list out =
      EpilogueFunction::apply(readable(sums), bias, if_any(team.of_team), if_any(team.alive),
                              alone ? kRowsWithoutTeam : team.n, static_cast<int64_t>(activation), differentiable);
  return {out[0], out.size() > 1 ? out[1] : at::Tensor()};
}

}  // namespace giga
