#include "policy/cpu_kernels.hpp"

// The parts are spread over threads already.
#define EIGEN_DONT_PARALLELIZE
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>

namespace giga {
namespace {

/// Rows that go through a network together: what lies between its layers stays in the second cache.
constexpr int kBlockRows = 256;

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Rows = Eigen::Block<Matrix, Eigen::Dynamic, Eigen::Dynamic, true>;

/// The agents of some states.
struct Block {
  int rows = 0, states = 0;
  std::array<int, kBlockRows + 1> begin;   // the first row of each state, and the end
  std::array<int64_t, kBlockRows> source;  // row of the rollout
  std::array<float, kBlockRows> share;     // of the mean of its state: 1 / living agents, 0 for the dead
};

enum class Who : uint8_t { living, all };

/// Fills a block with states from `next` on, and moves `next` behind them.
void choose(const FusedRows& rows, Who who, int64_t& next, int64_t end, Block& block) {
  block.rows = block.states = 0;
  for (; next < end && block.rows + rows.n <= kBlockRows; ++next) {
    const int64_t first = (rows.states ? rows.states[next] : next) * rows.n;
    const uint8_t* alive = rows.alive + first;
    int living = 0;
    for (int i = 0; i < rows.n; ++i) living += alive[i] ? 1 : 0;
    if (who == Who::living && living == 0) continue;
    const float share = living > 0 ? 1.0f / static_cast<float>(living) : 0.0f;
    block.begin[static_cast<size_t>(block.states++)] = block.rows;
    for (int i = 0; i < rows.n; ++i) {
      if (who == Who::living && !alive[i]) continue;
      block.source[static_cast<size_t>(block.rows)] = first + i;
      block.share[static_cast<size_t>(block.rows++)] = alive[i] ? share : 0.0f;
    }
  }
  block.begin[static_cast<size_t>(block.states)] = block.rows;
}

/// A network on a block, forward and back.
class BlockPass {
 public:
  explicit BlockPass(const FusedMlp& net) : net_(net) {
    for (int k = 0; k <= FusedMlp::kLayers; ++k) x_[k].resize(kBlockRows, net.width[k]);
    for (int k = 0; k < FusedMlp::kLayers; ++k) {
      slope_[k].resize(kBlockRows, net.width[k + 1]);
      if (net.team_weight[k] < 0) continue;
      mean_[k].resize(kBlockRows, net.width[k]);
      team_[k].resize(kBlockRows, net.width[k + 1]);
    }
  }

  /// The output [rows, width of the output] of the network with these parameters.
  Rows forward(const float* parameters, const FusedRows& rows, const Block& block) {
    parameters_ = parameters;
    gather(rows, block);
    for (int k = 0; k < FusedMlp::kLayers; ++k) {
      Rows y = top(x_[k + 1], block.rows);
      y.noalias() = top(x_[k], block.rows) * weight(net_.weight[k], k).transpose();
      y.rowwise() += bias(k);
      if (net_.team_weight[k] >= 0) exchange(block, k, y);
      if (k + 1 < FusedMlp::kLayers) apply_activation(y, top(slope_[k], block.rows));
    }
    return top(x_[FusedMlp::kLayers], block.rows);
  }

  /// After forward: adds the gradient by the parameters to `gradient` [net.size], from that by the output, which is
  /// lost.
  void backward(const Block& block, Matrix& d_output, float* gradient) {
    Matrix* d = &d_output;
    for (int k = FusedMlp::kLayers - 1; k >= 0; --k) {
      const Rows dy = top(*d, block.rows);
      place(gradient + net_.weight[k], k).noalias() += dy.transpose() * top(x_[k], block.rows);
      Eigen::Map<Eigen::RowVectorXf>(gradient + net_.bias[k], net_.width[k + 1]) += dy.colwise().sum();
      const bool exchanges = net_.team_weight[k] >= 0;
      if (exchanges) {
        for (int s = 0; s < block.states; ++s) team_[k].row(s) = rows_of(*d, block, s).colwise().sum();
        place(gradient + net_.team_weight[k], k).noalias() +=
            top(team_[k], block.states).transpose() * top(mean_[k], block.states);
      }
      if (k == 0) break;
      Rows dx = top(d_[k - 1], block.rows, net_.width[k]);
      dx.noalias() = dy * weight(net_.weight[k], k);
      if (exchanges) {
        top(mean_[k], block.states).noalias() = top(team_[k], block.states) * weight(net_.team_weight[k], k);
        for (int s = 0; s < block.states; ++s)
          for (int r = block.begin[at(s)]; r < block.begin[at(s) + 1]; ++r)
            dx.row(r) += block.share[at(r)] * mean_[k].row(s);
      }
      dx.array() *= top(slope_[k - 1], block.rows).array();
      d = &d_[k - 1];
    }
  }

 private:
  static size_t at(int i) { return static_cast<size_t>(i); }
  static Rows top(Matrix& m, int rows) { return m.topRows(rows); }
  static Rows top(Matrix& m, int rows, int columns) {
    if (m.rows() < kBlockRows || m.cols() != columns) m.resize(kBlockRows, columns);
    return m.topRows(rows);
  }
  static Rows rows_of(Matrix& m, const Block& block, int state) {
    return m.middleRows(block.begin[at(state)], block.begin[at(state) + 1] - block.begin[at(state)]);
  }
  Eigen::Map<const Matrix> weight(int offset, int k) const {
    return {parameters_ + offset, net_.width[k + 1], net_.width[k]};
  }
  Eigen::Map<Matrix> place(float* at, int k) const { return {at, net_.width[k + 1], net_.width[k]}; }
  Eigen::Map<const Eigen::RowVectorXf> bias(int k) const { return {parameters_ + net_.bias[k], net_.width[k + 1]}; }

  void gather(const FusedRows& rows, const Block& block) {
    const Eigen::Index width = net_.width[0];
    using Numbers = Eigen::Map<const Eigen::Array<float, 1, Eigen::Dynamic>>;
    for (int r = 0; r < block.rows; ++r) {
      auto x = x_[0].row(r).array();
      x = Numbers(rows.obs + block.source[at(r)] * rows.obs_stride, width);
      if (!rows.obs_mean) continue;
      x = ((x - Numbers(rows.obs_mean, width)) / Numbers(rows.obs_std, width)).max(-rows.obs_limit).min(rows.obs_limit);
    }
  }

  /// Composed critics: a layer reads the mean of what the living agents of the team feed into it, too.
  void exchange(const Block& block, int k, Rows& y) {
    for (int s = 0; s < block.states; ++s) {
      auto mean = mean_[k].row(s);
      mean.setZero();
      for (int r = block.begin[at(s)]; r < block.begin[at(s) + 1]; ++r) mean += block.share[at(r)] * x_[k].row(r);
    }
    top(team_[k], block.states).noalias() = top(mean_[k], block.states) * weight(net_.team_weight[k], k).transpose();
    for (int s = 0; s < block.states; ++s)
      for (int r = block.begin[at(s)]; r < block.begin[at(s) + 1]; ++r) y.row(r) += team_[k].row(s);
  }

  void apply_activation(Rows& y, Rows slope) const {
    if (net_.activation == Activation::tanh) {  // what Eigen computes eight at a time
      y.array() = y.array().tanh();
      slope.array() = 1.0f - y.array().square();
      return;
    }
    for (Eigen::Index r = 0; r < y.rows(); ++r)
      for (Eigen::Index c = 0; c < y.cols(); ++c) {
        const Activated a = activate_with_slope(net_.activation, y(r, c));
        y(r, c) = a.value;
        slope(r, c) = a.slope;
      }
  }

  const FusedMlp net_;
  const float* parameters_ = nullptr;
  Matrix x_[FusedMlp::kLayers + 1];  // inputs of the layers, and the output
  Matrix slope_[FusedMlp::kLayers];  // of the activations
  Matrix mean_[FusedMlp::kLayers];   // [states, width] of what a layer reads; going back, its gradient
  Matrix team_[FusedMlp::kLayers];   // [states, width of the layer] what comes of the mean; going back, sums of states
  Matrix d_[FusedMlp::kLayers - 1];  // gradients by the inputs of the layers above the first
};

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
template <class Net, class Loss>
void add_gradient(const Net& k, const ThreadPool& pool, const Loss& loss) {
  pool.for_ranges(kCpuParts, [&](int64_t first_part, int64_t end_part, int) {
    BlockPass pass(k.net);
    Block block;
    Matrix d_output(kBlockRows, k.net.width[FusedMlp::kLayers]);
    for (int64_t part = first_part; part < end_part; ++part) {
      float* gradient = k.partial + part * (k.net.size + kFusedSums);
      std::fill_n(gradient, k.net.size + kFusedSums, 0.0f);
      const int64_t end = part_begin(k.rows.n_states, part + 1);
      for (int64_t next = part_begin(k.rows.n_states, part); next < end;) {
        choose(k.rows, Who::living, next, end, block);
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
    BlockPass pass(policy.net);
    Block block;
    for (int64_t b = first_block; b < end_block; ++b) {
      const int64_t group = b / blocks, begin = b % blocks * kBlockRows;
      const int64_t offset = group * policy.group_stride, first = group * policy.rows_per_group + begin;
      block.rows = static_cast<int>(std::min<int64_t>(kBlockRows, policy.rows_per_group - begin));
      for (int r = 0; r < block.rows; ++r) block.source[static_cast<size_t>(r)] = first + r;
      FusedRows rows{.obs = policy.obs, .obs_stride = policy.obs_stride, .obs_limit = policy.obs_limit};
      if (policy.obs_mean) {
        rows.obs_mean = policy.obs_mean + offset;
        rows.obs_std = policy.obs_std + offset;
      }
      const Rows head = pass.forward(policy.parameters + offset, rows, block);
      for (int r = 0; r < block.rows; ++r) {
        if (policy.actions == ActionKind::discrete)
          policy.discrete.sample<WideLogits>(first + r, head.row(r).data());
        else
          policy.continuous.sample(first + r, head.row(r).data());
      }
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
  add_gradient(actor, pool, [&](const Block& block, Rows head, Matrix& d_head, float* sums, float* gradient) {
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
  });
}

namespace {

/// Of the states that are chosen, or of all. Which states share a block depends on no number of threads either.
void write_values(const FusedCritic& critic, const ThreadPool& pool) {
  const int64_t n_states = critic.rows.n_states, states = kBlockRows / critic.rows.n;
  pool.for_ranges((n_states + states - 1) / states, [&](int64_t first_block, int64_t end_block, int) {
    BlockPass pass(critic.net);
    Block block;
    for (int64_t b = first_block; b < end_block; ++b) {
      int64_t next = b * states;
      choose(critic.rows, Who::all, next, std::min(next + states, n_states), block);
      const Rows values = pass.forward(critic.parameters, critic.rows, block);
      for (int r = 0; r < block.rows; ++r) critic.values[block.source[static_cast<size_t>(r)]] = values(r, 0);
    }
  });
}

}  // namespace

void run_critic_gradient(const FusedCritic& critic, const ThreadPool& pool) {
  if (critic.values) return write_values(critic, pool);
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
  add_gradient(critic, pool, [&](const Block& block, Rows value, Matrix& d_value, float* sums, float*) {
    for (int r = 0; r < block.rows; ++r) {
      const int64_t source = block.source[static_cast<size_t>(r)];
      const ValueError::Error e = of.error.of(value(r, 0), of.old_value[source], in.target(source));
      sums[0] += e.loss;
      d_value(r, 0) = of.value_coef * e.slope * moments.inv_count;
    }
  });
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
