#include "policy/cpu_kernels.hpp"

#include <algorithm>
#include <cmath>

#include "policy/cpu_passes.hpp"

namespace giga {
namespace {

/// A row of logits whose exponentials are computed eight at a time.
struct WideLogits : Logits {
  using Logits::Logits;
};
float softmax(const WideLogits& row, float (&p)[kLogitStride]) {
  constexpr int kWide = 32;
  Eigen::Array<float, kWide, 1> x;
  for (int k = 0; k < kNDiscreteActions; ++k) x[k] = row.x[k];
  x.tail<kWide - kNDiscreteActions>().setConstant(-INFINITY);
  const float top = x.maxCoeff();
  x = (x - top).exp();
  for (int k = kNDiscreteActions; k < kWide; ++k) x[k] = 0;
  const float sum = x.sum();
  x *= 1.0f / sum;
  for (int k = 0; k < kLogitStride; ++k) p[k] = x[k];
  return top + std::log(sum);
}

/// What the moments of a minibatch say.
struct Moments {
  float inv_count, mean, inv_std;

  explicit Moments(const double* moments) {
    double sums[kMoments] = {};
    for (int part = 0; part < kMomentParts; ++part)
      for (int k = 0; k < kMoments; ++k) sums[k] += moments[part * kMoments + k];
    const double count = std::max(1.0, sums[0]), average = sums[1] / count;
    inv_count = static_cast<float>(1.0 / count);
    mean = static_cast<float>(average);
    inv_std = static_cast<float>(1.0 / (std::sqrt(std::max(0.0, sums[2] / count - average * average)) + 1e-8));
  }
};

int64_t part_begin(int64_t n_states, int64_t part) { return n_states * part / kCpuParts; }

/// The gradients of all parts of a minibatch. `loss(block, output, d_output, sums, gradient)` writes the gradient by
/// the output, adds to the part's sums [kFusedSums], and to the gradient by parameters that are no layer's.
template <class Pass, class Net, class Loss>
void add_gradient(const Net& k, const ThreadPool& pool, const Loss& loss) {
  pool.for_ranges(kCpuParts, [&](int64_t first_part, int64_t end_part, int) {
    Pass pass(k.net);
    Block block;
    Matrix d_output(kBlockRows, k.net.width[FusedMlp::kLayers]);
    for (int64_t part = first_part; part < end_part; ++part) {
      float* gradient = k.partial + part * (k.net.size + kFusedSums);
      std::fill_n(gradient, k.net.size + kFusedSums, 0.0f);
      const int64_t end = part_begin(k.rows.n_states, part + 1);
      for (int64_t next = part_begin(k.rows.n_states, part); next < end;) {
        choose(k.rows, Who::living, most_states(k.net), next, end, block);
        if (block.rows == 0) continue;
        loss(block, pass.forward(k.parameters, k.rows, block), d_output, gradient + k.net.size, gradient);
        pass.backward(block, d_output, gradient);
      }
    }
  });
}

}  // namespace

void run_fused_policy(const FusedPolicy& policy, const ThreadPool& pool) {
  const int64_t blocks = (policy.rows_per_group + kBlockRows - 1) / kBlockRows;
  pool.for_ranges(policy.groups * blocks, [&](int64_t first_block, int64_t end_block, int) {
    ObservationPass pass(policy.net);
    Block block;
    for (int64_t b = first_block; b < end_block; ++b) {
      const int64_t group = b / blocks, begin = b % blocks * kBlockRows;
      if (!policy.group_plays(group)) continue;
      const int64_t offset = group * policy.group_stride, first = group * policy.rows_per_group + begin;
      block.rows = static_cast<int>(std::min<int64_t>(kBlockRows, policy.rows_per_group - begin));
      for (int r = 0; r < block.rows; ++r) block.source[static_cast<size_t>(r)] = first + r;
      const FusedRows rows = policy.rows(offset);
      const SampleGaussian continuous = policy.gaussian(offset);
      const Rows head = pass.forward(policy.parameters + offset, rows, block);
      for (int r = 0; r < block.rows; ++r) policy.sample<WideLogits>(first + r, head.row(r).data(), continuous);
    }
  });
}

void run_moments(const FusedRows& rows, MinibatchPieces pieces, const float* advantage, double* moments) {
  std::fill_n(moments, static_cast<int64_t>(pieces.n_pieces) * kMomentParts * kMoments, 0.0);
  for (int piece = 0; piece < pieces.n_pieces; ++piece) {
    double* sums = moments + static_cast<int64_t>(piece) * kMomentParts * kMoments;
    for (int64_t row = pieces.begin(piece) * rows.n; row < pieces.begin(piece + 1) * rows.n; ++row) {
      const int64_t source = RowIndex{rows.states, rows.n}.source(row);
      if (!rows.alive[source]) continue;
      const double a = static_cast<double>(advantage[source]);
      sums[0] += 1;
      sums[1] += a;
      sums[2] += a * a;
    }
  }
}

void run_actor_gradient(const FusedActor& actor, const ThreadPool& pool) {
  const Moments moments(actor.moments);
  const FusedPolicyLoss& of = actor.loss;
  const float mean = of.advantage_mean ? *of.advantage_mean : moments.mean;
  const float inv_std = of.advantage_inv_std ? *of.advantage_inv_std : moments.inv_std;
  const auto loss = [&](const Block& block, Rows head, Matrix& d_head, float* sums, float* gradient) {
    const PolicyLossInput in{.rows = {},
                             .old_log_prob = of.old_log_prob,
                             .advantage = of.advantage,
                             .alive = actor.rows.alive,
                             .advantage_mean = &mean,
                             .advantage_inv_std = &inv_std,
                             .inv_count = &moments.inv_count,
                             .entropy_coef = of.entropy_coef,
                             .clip_coef = of.clip_coef};
    for (int r = 0; r < block.rows; ++r) {
      const int64_t source = block.source[static_cast<size_t>(r)];
      float diagnostics[kNPolicyDiagnostics];
      if (of.action) {
        WideLogits logits(head.row(r).data());
        categorical_gradient(logits, of.action[source], in.sample(source), diagnostics);
        logits.store(d_head.row(r).data());
      } else {
        float d_log_std[kActionSize];
        gaussian_gradient(head.row(r).data(), actor.parameters + actor.net.log_std,
                          of.pre_tanh_action + source * kActionSize, in.sample(source), d_head.row(r).data(), d_log_std,
                          diagnostics);
        for (int k = 0; k < kActionSize; ++k) gradient[actor.net.log_std + k] += d_log_std[k];
      }
      for (int k = 0; k < kNPolicyDiagnostics; ++k) sums[k] += diagnostics[k];
    }
  };
  add_gradient<ObservationPass>(actor, pool, loss);
}

namespace {

/// Of the states that are chosen, or of all. Which states share a block depends on no number of threads either.
template <class Pass>
void write_values(const FusedCritic& critic, const ThreadPool& pool) {
  const int64_t n_states = critic.rows.n_states;
  const int states = std::min(kBlockRows / critic.rows.n, most_states(critic.net));
  pool.for_ranges((n_states + states - 1) / states, [&](int64_t first_block, int64_t end_block, int) {
    Pass pass(critic.net);
    Block block;
    for (int64_t b = first_block; b < end_block; ++b) {
      int64_t next = b * states;
      choose(critic.rows, Who::all, states, next, std::min(next + states, n_states), block);
      const Rows values = pass.forward(critic.parameters, critic.rows, block);
      for (int r = 0; r < block.rows; ++r) critic.values[block.source[static_cast<size_t>(r)]] = values(r, 0);
    }
  });
}

template <class Pass>
void add_critic_gradient(const FusedCritic& critic, const ThreadPool& pool) {
  const Moments moments(critic.moments);
  const FusedValueLoss& of = critic.loss;
  const ValueLoss in{.rows = {},
                     .value = nullptr,
                     .old_value = of.old_value,
                     .returns = of.returns,
                     .alive = critic.rows.alive,
                     .value_mean = of.value_mean,
                     .value_std = of.value_std,
                     .inv_count = &moments.inv_count,
                     .value_coef = of.value_coef,
                     .error = of.error,
                     .d_value = nullptr,
                     .loss = nullptr};
  add_gradient<Pass>(critic, pool, [&](const Block& block, Rows value, Matrix& d_value, float* sums, float*) {
    for (int r = 0; r < block.rows; ++r) {
      const int64_t source = block.source[static_cast<size_t>(r)];
      const ValueError::Error e = of.error.of(value(r, 0), of.old_value[source], in.target(source));
      sums[0] += e.loss;
      d_value(r, 0) = of.value_coef * e.slope * moments.inv_count;
    }
  });
}

template <class Pass>
void run_critic(const FusedCritic& critic, const ThreadPool& pool) {
  critic.values ? write_values<Pass>(critic, pool) : add_critic_gradient<Pass>(critic, pool);
}

}  // namespace

void run_critic_gradient(const FusedCritic& critic, const ThreadPool& pool) {
  critic.net.reads_state() ? run_critic<StatePass>(critic, pool) : run_critic<ObservationPass>(critic, pool);
}

void run_gradient_sums(const FusedStep& step) {
  for (const FusedStep::Network* net : {&step.actor, &step.critic}) {
    const int64_t stride = net->size + kFusedSums;
    const auto row = [&](int64_t part) {
      return Eigen::Map<const Eigen::ArrayXf>(net->partial + part * stride, stride);
    };
    Eigen::ArrayXf sum = row(0);
    for (int part = 1; part < net->n_partial; ++part) sum += row(part);
    std::copy_n(sum.data(), net->size, net->adam.gradient);
    std::copy_n(sum.data() + net->size, kFusedSums, net->sums);
    *net->norm = static_cast<float>(sum.head(net->size).matrix().cast<double>().norm());
  }
  step.note(0);
  *step.value_loss += step.critic.sums[0];
  step.actor.gate(0);
  step.critic.gate(0);
}

void run_adam(const FusedStep& step) {
  for (const FusedStep::Network* net : {&step.actor, &step.critic})
    for (int64_t k = 0; k < net->size; ++k) net->adam(k);
}

}  // namespace giga
