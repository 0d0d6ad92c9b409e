// The PPO losses and their gradients in closed form, row by row (Schulman et al. 2017, equations 7 and 9; Yu et al.
// 2022, appendix A). Each row writes the gradient of the mean loss over living agents; the network's backward pass
// starts there.
#pragma once

#include <cmath>

#include "math/distributions.hpp"
#include "math/rows.hpp"

namespace giga {

/// Columns of the diagnostics of a row. They are 0 for the dead: a column's sum over that of kLossCount is a mean.
enum PolicyDiagnostic : int {
  kLossPolicy,
  kLossEntropy,
  kLossKl,          ///< (ratio - 1) - log ratio, Schulman's estimator of KL(old || new)
  kLossClipped,     ///< 1 where |ratio - 1| > clip_coef
  kLossRatioError,  ///< |ratio - 1|
  kLossCount,       ///< 1
  kNPolicyDiagnostics
};

/// What the policy's loss takes of one row besides the network's output.
struct PolicySample {
  float old_log_prob, advantage;  ///< the advantage as it is normalised
  float inv_count;                ///< 1 / living rows of the minibatch
  float clip_coef, entropy_coef;
};

/// What both policy losses read.
struct PolicyLossInput {
  RowIndex rows;
  const float* old_log_prob;       // [rollout rows]
  const float* advantage;          // [rollout rows]
  const uint8_t* alive;            // [rollout rows]
  const float* advantage_mean;     // scalar
  const float* advantage_inv_std;  // scalar
  const float* inv_count;          // scalar: 1 / living rows of the minibatch
  const float* entropy_coef;       // scalar
  const float* clip_coef;          // scalar

  GIGA_HD PolicySample sample(int64_t source) const {
    return {old_log_prob[source], (advantage[source] - *advantage_mean) * *advantage_inv_std, *inv_count, *clip_coef,
            *entropy_coef};
  }
};

/// The clipped surrogate (equation 7) for one row.
struct Surrogate {
  float loss, d_log_prob;  ///< and its derivative by the log-probability
  float ratio, kl;
  bool clipped;
};
GIGA_HD Surrogate clipped_surrogate(float log_prob, float old_log_prob, float advantage, float clip_coef) {
  const float log_ratio = log_prob - old_log_prob, ratio = std::exp(log_ratio);
  const float lo = 1.0f - clip_coef, hi = 1.0f + clip_coef;
  const float held = ratio < lo ? lo : (ratio > hi ? hi : ratio);
  const float plain_gain = ratio * advantage, held_gain = held * advantage;
  // Where the clipped gain is the smaller one it does not depend on the policy.
  const bool flat = held_gain < plain_gain;
  return {-(flat ? held_gain : plain_gain), flat ? 0.0f : -plain_gain, ratio, ratio - 1.0f - log_ratio,
          ratio < lo || ratio > hi};
}

GIGA_HD void write_diagnostics(float* out, const Surrogate& s, float entropy) {
  out[kLossPolicy] = s.loss;
  out[kLossEntropy] = entropy;
  out[kLossKl] = s.kl;
  out[kLossClipped] = s.clipped ? 1.0f : 0.0f;
  out[kLossRatioError] = s.ratio > 1 ? s.ratio - 1 : 1 - s.ratio;
  out[kLossCount] = 1;
}

/// loss = surrogate - entropy_coef * entropy of a categorical policy, for a living row: its gradient takes the place of
/// the logits.
template <class Row>
GIGA_HD void categorical_gradient(Row& l, int chosen, const PolicySample& of, float* diagnostic) {
  float p[Row::kNumbers];
  const float lse = softmax(l, p);
  float entropy = 0, of_chosen = 0;
  GIGA_UNROLL
  for (int k = 0; k < Row::kNumbers; ++k) {
    if (l.is_action(k)) entropy -= p[k] * (l.x[k] - lse);
    of_chosen = l.column(k) == chosen ? l.x[k] : of_chosen;
  }
  entropy = l.total(entropy);
  const Surrogate s = clipped_surrogate(l.total(of_chosen) - lse, of.old_log_prob, of.advantage, of.clip_coef);
  // d log p(chosen) / d x_k = [k = chosen] - p_k;  d entropy / d x_k = -p_k (log p_k + entropy)
  GIGA_UNROLL
  for (int k = 0; k < Row::kNumbers; ++k) {
    const float chose = l.column(k) == chosen ? 1.0f : 0.0f;
    const float slope = s.d_log_prob * (chose - p[k]) + of.entropy_coef * p[k] * (l.x[k] - lse + entropy);
    l.x[k] = l.is_action(k) ? slope * of.inv_count : 0.0f;
  }
  write_diagnostics(diagnostic, s, entropy);
}

/// The same for all rows.
struct CategoricalLoss {
  PolicyLossInput in;
  const float* logits;    // [R, kLogitStride]
  const int32_t* action;  // [rollout rows]
  float* d_logits;        // [R, kLogitStride]
  float* diagnostics;     // [R, kNPolicyDiagnostics]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t source = in.rows.source(row);
    Logits l(logits + row * kLogitStride);
    float* diagnostic = diagnostics + row * kNPolicyDiagnostics;
    if (!in.alive[source]) {
      GIGA_UNROLL
      for (int k = 0; k < kLogitStride; ++k) l.x[k] = 0;
      l.store(d_logits + row * kLogitStride);
      for (int k = 0; k < kNPolicyDiagnostics; ++k) diagnostic[k] = 0;
      return;
    }
    categorical_gradient(l, action[source], in.sample(source), diagnostic);
    l.store(d_logits + row * kLogitStride);
  }
};

/// The same for the squashed Gaussian: mean, log_std, u before tanh [3] -> gradients by mean and log_std [3]. The
/// entropy is that of the action tanh(u).
GIGA_HD void gaussian_gradient(const float* mean, const float* log_std, const float* u, const PolicySample& of,
                               float* d_mean, float* d_log_std, float* diagnostic) {
  constexpr int kSize = SampleGaussian::kSize;
  float log_prob = 0, entropy = 0;
  SquashEntropy squash[kSize];
  for (int k = 0; k < kSize; ++k) {
    log_prob += squashed_log_prob(u[k], mean[k], log_std[k]);
    squash[k] = squash_entropy(mean[k], std::exp(log_std[k]));
    entropy += log_std[k] + 0.5f + kHalfLogTwoPi + squash[k].value;
  }
  const Surrogate s = clipped_surrogate(log_prob, of.old_log_prob, of.advantage, of.clip_coef);
  // d log p / d mean = e / sigma;  d log p / d log_std = e^2 - 1;  d entropy / d log_std = 1 + what squashing adds
  for (int k = 0; k < kSize; ++k) {
    const float inv_std = std::exp(-log_std[k]);
    const float e = (u[k] - mean[k]) * inv_std;
    d_mean[k] = (s.d_log_prob * e * inv_std - of.entropy_coef * squash[k].by_mean) * of.inv_count;
    d_log_std[k] = (s.d_log_prob * (e * e - 1.0f) - of.entropy_coef * (1.0f + squash[k].by_log_std)) * of.inv_count;
  }
  write_diagnostics(diagnostic, s, entropy);
}

/// The same for all rows.
struct GaussianLoss {
  static constexpr int kSize = SampleGaussian::kSize;
  PolicyLossInput in;
  const float* mean;             // [R, 3]
  const float* log_std;          // [3]
  const float* pre_tanh_action;  // [rollout rows, 3] u before tanh
  float* d_mean;                 // [R, 3]
  float* d_log_std;              // [R, 3] to be summed over rows
  float* diagnostics;            // [R, kNPolicyDiagnostics]

  GIGA_HD void operator()(int64_t row) const {
    const int64_t source = in.rows.source(row);
    float* diagnostic = diagnostics + row * kNPolicyDiagnostics;
    if (!in.alive[source]) {
      for (int k = 0; k < kSize; ++k) d_mean[row * kSize + k] = d_log_std[row * kSize + k] = 0;
      for (int k = 0; k < kNPolicyDiagnostics; ++k) diagnostic[k] = 0;
      return;
    }
    gaussian_gradient(mean + row * kSize, log_std, pre_tanh_action + source * kSize, in.sample(source),
                      d_mean + row * kSize, d_log_std + row * kSize, diagnostic);
  }
};

/// Squared or Huber value loss, clipped around the old value or not, in units of the network's output. The old value is
/// the output itself, because the normaliser has moved since: in reward units, the same output is another number now.
struct ValueError {
  float clip_coef;    ///< 0 = no clipping
  float huber_delta;  ///< 0 = squared error / 2

  struct Error {
    float loss, slope;
  };
  GIGA_HD Error of(float e) const {
    const float size = e < 0 ? -e : e;
    if (huber_delta <= 0 || size <= huber_delta) return {0.5f * e * e, e};
    return {huber_delta * (size - 0.5f * huber_delta), e < 0 ? -huber_delta : huber_delta};
  }
  GIGA_HD Error of(float value, float old, float target) const {
    const Error plain = of(value - target);
    const float moved = value - old;
    if (clip_coef > 0 && (moved < -clip_coef || moved > clip_coef)) {
      const Error held = of(old + (moved < 0 ? -clip_coef : clip_coef) - target);
      if (held.loss > plain.loss) return {held.loss, 0.0f};  // which does not depend on the value
    }
    return plain;
  }
};

/// The value loss of all rows.
struct ValueLoss {
  RowIndex rows;
  const float* value;       // [R] the network's output
  const float* old_value;   // [rollout rows] its output for the rollout
  const float* returns;     // [rollout rows] in reward units
  const uint8_t* alive;     // [rollout rows]
  const float* value_mean;  // scalar of the normaliser; null = 0
  const float* value_std;   // scalar; null = 1
  const float* inv_count;   // scalar
  float value_coef;
  ValueError error;
  float* d_value;  // [R]
  float* loss;     // [R]; 0 for the dead

  /// The return in units of the network's output.
  GIGA_HD float target(int64_t source) const {
    const float mean = value_mean ? *value_mean : 0.0f, inv_std = 1.0f / (value_std ? *value_std : 1.0f);
    return (returns[source] - mean) * inv_std;
  }
  GIGA_HD void operator()(int64_t row) const {
    const int64_t source = rows.source(row);
    if (!alive[source]) {
      d_value[row] = loss[row] = 0;
      return;
    }
    const ValueError::Error e = error.of(value[row], old_value[source], target(source));
    loss[row] = e.loss;
    d_value[row] = value_coef * e.slope * *inv_count;
  }
};

}  // namespace giga
