#include "policy/recurrent_cell.hpp"

#include <torch/autograd.h>
#include <torch/types.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/error.hpp"
#include "math/recurrent.hpp"
#include "policy/layers.hpp"
#include "policy/run_elementwise.hpp"

namespace giga {
namespace {

constexpr int64_t kGrain = 4096;  // numbers of a CPU thread at least

int64_t gates_of(MemoryKind kind) { return kind == MemoryKind::lstm ? 4 : 3; }

/// Runs an operation on rows of op.size numbers each, on the device of `x`: on LibTorch's threads, or queued on its
/// stream.
template <class Op>
void run(const Op& op, int64_t rows, const at::Tensor& x) {
  if (x.is_cuda())
    return launch_elementwise(op, rows * op.size, static_cast<int>(x.device().index()), libtorch_stream(x));
  at::parallel_for(0, rows, std::max<int64_t>(1, kGrain / op.size), [&op](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r)
      for (int64_t j = 0; j < op.size; ++j) op(CellElement(r, j, op.size));
  });
}

const float* data_of(const at::Tensor& x) { return x.const_data_ptr<float>(); }
const bool* begins_at(const at::Tensor& begins, int64_t t) {
  return begins.defined() && t < begins.size(0) ? begins.const_data_ptr<bool>() + t * begins.size(1) : nullptr;
}

/// L steps of a cell as they were computed; what the gradient needs of them.
struct Steps {
  at::Tensor features;     // [L, R, H]
  at::Tensor cell;         // [L, R, H] of an LSTM
  at::Tensor before;       // [L + 1, R, H] h before each step and after the last, zero where an episode begins
  at::Tensor before_cell;  // [L + 1, R, H] likewise c, of an LSTM
  at::Tensor gates;        // [L, R, 4 H]

  Steps() = default;
  Steps(int64_t l, int64_t r, int64_t h, bool lstm, const at::TensorOptions& options)
      : features(at::empty({l, r, h}, options)),
        cell(lstm ? at::empty({l, r, h}, options) : at::Tensor()),
        before(at::empty({l + 1, r, h}, options)),
        before_cell(lstm ? at::empty({l + 1, r, h}, options) : at::Tensor()),
        gates(at::empty({l, r, 4 * h}, options)) {}

  /// The state [R, S] before the first step; undefined: nothing is remembered.
  void begin(const at::Tensor& start, const at::Tensor& begins) {
    const int64_t h = features.size(2);
    const auto put = [&](const at::Tensor& to, int64_t first) {
      if (!start.defined()) return to.zero_();
      to.copy_(start.narrow(1, first, h));
      return begins.defined() ? to.masked_fill_(begins[0].unsqueeze(1), 0) : to;
    };
    put(before[0], 0);
    if (cell.defined()) put(before_cell[0], h);
  }

  /// Step t, from the sums `input` and `hidden` [R, G H].
  void step(int64_t t, const at::Tensor& input, const at::Tensor& hidden, const at::Tensor& begins) const {
    const int64_t h = features.size(2);
    const auto slot = [](const at::Tensor& x, int64_t k) { return x.data_ptr<float>() + k * x.stride(0); };
    if (cell.defined())
      run(LstmStep{.size = h,
                   .input = data_of(input),
                   .hidden = data_of(hidden),
                   .before = slot(before_cell, t),
                   .begins = begins_at(begins, t + 1),
                   .gates = slot(gates, t),
                   .cell = slot(cell, t),
                   .features = slot(features, t),
                   .after = slot(before, t + 1),
                   .after_cell = slot(before_cell, t + 1)},
          features.size(1), features);
    else
      run(GruStep{.size = h,
                  .input = data_of(input),
                  .hidden = data_of(hidden),
                  .before = slot(before, t),
                  .begins = begins_at(begins, t + 1),
                  .gates = slot(gates, t),
                  .features = slot(features, t),
                  .after = slot(before, t + 1)},
          features.size(1), features);
  }

  /// What is remembered after each step: [L, R, S].
  at::Tensor states() const { return cell.defined() ? at::cat({features, cell}, 2) : features; }
};

/// All steps, from the sums of the inputs [L, R, G H].
Steps all_steps(const at::Tensor& input, const at::Tensor& weight, const at::Tensor& bias, const at::Tensor& start,
                const at::Tensor& begins) {
  const int64_t l = input.size(0), r = input.size(1), h = weight.size(1);
  Steps steps(l, r, h, weight.size(0) == 4 * h, input.options());
  steps.begin(start, begins);
  at::Tensor hidden = at::empty({r, weight.size(0)}, input.options());
  for (int64_t t = 0; t < l; ++t) {
    at::addmm_out(hidden, bias, steps.before[t], weight.t());
    steps.step(t, input[t], hidden, begins);
  }
  return steps;
}

/// The steps with their gradient by hand: autograd would queue ten times as many kernels for each step.
struct RecurrentFunction : torch::autograd::Function<RecurrentFunction> {
  /// -> features [L, R, H] and the states after each step.
  static torch::autograd::variable_list forward(torch::autograd::AutogradContext* context, const at::Tensor& input,
                                                const at::Tensor& weight, const at::Tensor& bias,
                                                const std::optional<at::Tensor>& start,
                                                const std::optional<at::Tensor>& begins) {
    const Steps s = all_steps(input, weight, bias, start.value_or(at::Tensor()), begins.value_or(at::Tensor()));
    context->save_for_backward({weight, s.before, s.before_cell, s.cell, s.gates, begins.value_or(at::Tensor())});
    const at::Tensor states = s.cell.defined() ? s.states() : s.features.clone();
    context->mark_non_differentiable({states});
    return {s.features, states};
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto saved = context->get_saved_variables();
    const at::Tensor &weight = saved[0], &before = saved[1], &before_cell = saved[2], &cell = saved[3],
                     &gates = saved[4], &begins = saved[5];
    const at::Tensor d_features = gradients[0].contiguous();
    const int64_t l = d_features.size(0), r = d_features.size(1), h = d_features.size(2), g = weight.size(0);
    const at::Tensor d_hidden = at::empty({l, r, g}, d_features.options());
    const at::Tensor d_input = cell.defined() ? d_hidden : at::empty_like(d_hidden);
    at::Tensor carried = at::zeros({r, h}, d_features.options());
    const at::Tensor carried_cell = cell.defined() ? at::zeros_like(carried) : at::Tensor();
    const auto slot = [](const at::Tensor& x, int64_t t) { return x.data_ptr<float>() + t * x.stride(0); };
    for (int64_t t = l - 1; t >= 0; --t) {
      if (cell.defined()) {
        run(LstmStepGradient{.size = h,
                             .gates = slot(gates, t),
                             .before = slot(before_cell, t),
                             .cell = slot(cell, t),
                             .begins = begins_at(begins, t + 1),
                             .d_features = slot(d_features, t),
                             .carried = data_of(carried),
                             .carried_cell = carried_cell.data_ptr<float>(),
                             .d_sums = slot(d_hidden, t)},
            r, d_features);
        at::mm_out(carried, d_hidden[t], weight);
      } else {
        run(GruStepGradient{.size = h,
                            .gates = slot(gates, t),
                            .before = slot(before, t),
                            .begins = begins_at(begins, t + 1),
                            .d_features = slot(d_features, t),
                            .carried = carried.data_ptr<float>(),
                            .d_input = slot(d_input, t),
                            .d_hidden = slot(d_hidden, t)},
            r, d_features);
        carried.addmm_(d_hidden[t], weight);
      }
    }
    const at::Tensor d_rows = d_hidden.view({l * r, g});
    return {d_input, at::mm(d_rows.t(), before.narrow(0, 0, l).view({l * r, h})), d_rows.sum(0), at::Tensor(),
            at::Tensor()};
  }
};

}  // namespace

RecurrentCell::RecurrentCell(ParameterSet& parameters, const std::string& name, MemoryKind kind, int64_t input,
                             int64_t size)
    : kind_(kind), size_(size) {
  const int64_t gates = gates_of(kind);
  // The weights of a gate start about as orthogonal ones of gain 1 would: those of all gates are one matrix.
  const Init weight{Init::Kind::orthogonal, std::sqrt(static_cast<float>(gates))};
  // A forget gate that starts half open loses in ten steps what it should keep (Gers et al. 2000, section 4; Jozefowicz
  // et al. 2015).
  Init input_bias{Init::Kind::constant, 0};
  if (kind == MemoryKind::lstm) input_bias.part = {size, size, 1};
  input_weight_ = parameters.add(name + "/input_weight", {gates * size, input}, weight);
  input_bias_ = parameters.add(name + "/input_bias", {gates * size}, input_bias);
  hidden_weight_ = parameters.add(name + "/hidden_weight", {gates * size, size}, weight);
  hidden_bias_ = parameters.add(name + "/hidden_bias", {gates * size}, {Init::Kind::constant, 0});
}

at::Tensor RecurrentCell::forward(const ParameterSet& p, const at::Tensor& x, const Sequence& sequence) const {
  const int64_t l = sequence.length, g = gates_of(kind_) * size_;
  const at::Tensor input = linear(x, p[input_weight_], p[input_bias_]).to(at::kFloat).reshape({l, -1, g});
  const at::Tensor begins = sequence.begins.defined() ? sequence.begins.contiguous() : at::Tensor();
  const at::Tensor &weight = p.exact(hidden_weight_), &bias = p.exact(hidden_bias_);
  at::Tensor features, states;
  if (at::GradMode::is_enabled()) {
    const auto given = [](const at::Tensor& t) { return t.defined() ? std::optional(t) : std::nullopt; };
    const auto out = RecurrentFunction::apply(input, weight, bias, given(sequence.start), given(begins));
    features = out[0];
    states = out[1];
  } else {
    const Steps steps = all_steps(input, weight, bias, sequence.start, begins);
    features = steps.features;
    if (sequence.states) states = steps.states();
  }
  if (sequence.states) *sequence.states = states;
  return features.view({-1, size_}).to(x.scalar_type());
}

at::Tensor RecurrentCell::forward_members(const ParameterSet& p, const at::Tensor& members, const at::Tensor& x,
                                          NetworkState& state) const {
  at::NoGradGuard no_grad;
  const int64_t m = x.size(0), r = x.size(1);
  const auto product = [&](const at::Tensor& rows, int weight, int bias) {
    const at::Tensor sums = at::baddbmm(p.of_members(members, bias).unsqueeze(1).to(rows.scalar_type()), rows,
                                        p.of_members(members, weight).transpose(1, 2).to(rows.scalar_type()));
    return sums.to(at::kFloat).contiguous();
  };
  Steps one(1, m * r, size_, kind_ == MemoryKind::lstm, x.options().dtype(at::kFloat).requires_grad(false));
  one.begin(state.rows.defined() ? state.rows.reshape({m * r, -1}) : at::Tensor(), {});
  const at::Tensor hidden = product(one.before[0].view({m, r, size_}), hidden_weight_, hidden_bias_);
  one.step(0, product(x, input_weight_, input_bias_), hidden, {});
  state.rows = one.states()[0].view({m, r, -1});
  return one.features.view({m, r, size_}).to(x.scalar_type());
}

}  // namespace giga
