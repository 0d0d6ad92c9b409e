// Action distributions: categorical over logits, and a diagonal Gaussian squashed by tanh.
#pragma once

#include <cmath>

#include "core/host_device.hpp"
#include "core/philox.hpp"
#include "math/normal.hpp"
#include "math/rows.hpp"
#include "sim/params.hpp"

namespace giga {

/// Numbers in a row of logits: one per action and one that is not used. Rows are then whole 16-byte words, and aligned
/// for matrix products.
constexpr int kLogitStride = 28;
static_assert(kLogitStride >= kNDiscreteActions && kLogitStride % 4 == 0);

struct alignas(16) Quad {
  float v[4];
};

/// The probabilities of the actions of a row, 0 for numbers that are none; returns log(sum(exp(x))). Neither overflows.
/// A row is Logits, or has the same members and is spread over several lanes, each with some of the numbers.
template <class Row>
GIGA_HD float softmax(const Row& row, float (&p)[Row::kNumbers]) {
  float top = -INFINITY;
  GIGA_UNROLL
  for (int k = 0; k < Row::kNumbers; ++k)
    if (row.is_action(k)) top = row.x[k] > top ? row.x[k] : top;
  top = row.greatest(top);
  float sum = 0;
  GIGA_UNROLL
  for (int k = 0; k < Row::kNumbers; ++k) {
    p[k] = row.is_action(k) ? std::exp(row.x[k] - top) : 0.0f;
    sum += p[k];
  }
  sum = row.total_of(p, sum);
  const float inverse = 1.0f / sum;
  GIGA_UNROLL
  for (int k = 0; k < Row::kNumbers; ++k) p[k] *= inverse;
  return top + std::log(sum);
}

/// A row of logits in registers: all loops over it have constant bounds. Rows are aligned to 16 bytes.
struct Logits {
  static constexpr int kNumbers = kLogitStride;
  float x[kNumbers];

  GIGA_HD explicit Logits(const float* row) {
    const Quad* quads = reinterpret_cast<const Quad*>(row);
    GIGA_UNROLL
    for (int k = 0; k < kLogitStride / 4; ++k) {
      const Quad q = quads[k];
      GIGA_UNROLL
      for (int j = 0; j < 4; ++j) x[4 * k + j] = q.v[j];
    }
  }
  GIGA_HD void store(float* row) const {
    Quad* quads = reinterpret_cast<Quad*>(row);
    GIGA_UNROLL
    for (int k = 0; k < kLogitStride / 4; ++k) quads[k] = {{x[4 * k], x[4 * k + 1], x[4 * k + 2], x[4 * k + 3]}};
  }
  /// The action of number k, and whether it is one; all lanes' sum and greatest: there is one lane.
  GIGA_HD static int column(int k) { return k; }
  GIGA_HD static bool is_action(int k) { return k < kNDiscreteActions; }
  GIGA_HD static float total(float sum) { return sum; }
  /// The total of the numbers p, which this lane's add up to `sum`.
  GIGA_HD static float total_of(const float (&)[kNumbers], float sum) { return sum; }
  GIGA_HD static float greatest(float top) { return top; }
  /// The action with the largest logit, the first of equal ones.
  GIGA_HD int largest() const {
    float top = x[0];
    int chosen = 0;
    GIGA_UNROLL
    for (int k = 1; k < kNDiscreteActions; ++k)
      if (x[k] > top) {
        top = x[k];
        chosen = k;
      }
    return chosen;
  }
  /// The number by which a row's action is drawn.
  GIGA_HD static float uniform(const RowDraws& draws, int64_t row) {
    return draws.key(row).uniform(Draw::action, draws.agent(row), 0);
  }
  /// An action drawn with probabilities p, by inverting the distribution function at u. What rounding leaves goes to
  /// the last action.
  GIGA_HD static int draw(const float (&p)[kNumbers], float u) {
    float below = 0;
    int chosen = 0;
    GIGA_UNROLL
    for (int k = 0; k < kNDiscreteActions - 1; ++k) {
      below += p[k];
      chosen += u >= below ? 1 : 0;
    }
    return chosen;
  }
  /// x[index]. Indexing would move the row out of registers.
  GIGA_HD float at(int index) const {
    float value = x[0];
    GIGA_UNROLL
    for (int k = 1; k < kNDiscreteActions; ++k) value = k == index ? x[k] : value;
    return value;
  }
};

/// Samples an action per row from logits.
struct SampleCategorical {
  const float* logits;  // [R, kLogitStride]
  RowDraws draws;
  int32_t* action;  // [R]
  float* log_prob;  // [R]; null = not wanted
  bool greedy = false;

  GIGA_HD void operator()(int64_t row) const { sample(row, logits + row * kLogitStride); }
  /// The number by which a row's action is drawn; 0 where none is.
  GIGA_HD float uniform(int64_t row) const { return greedy ? 0.0f : Logits::uniform(draws, row); }
  /// Of a row whose logits lie elsewhere.
  template <class Row = Logits>
  GIGA_HD void sample(int64_t row, const float* row_logits) const {
    keep(row, choose(Row(row_logits), [&] { return Logits::uniform(draws, row); }));
  }
  struct Choice {
    int action;
    float log_prob;
  };
  /// u(): the number by which the action is drawn.
  template <class Row, class U>
  GIGA_HD Choice choose(const Row& l, U&& u) const {
    float p[Row::kNumbers];
    const float lse = softmax(l, p);
    const int chosen = greedy ? l.largest() : l.draw(p, u());
    return {chosen, log_prob ? l.at(chosen) - lse : 0.0f};
  }
  GIGA_HD void keep(int64_t row, const Choice& choice) const {
    action[row] = choice.action;
    if (log_prob) log_prob[row] = choice.log_prob;
  }
};

constexpr float kLogTwo = 0.69314718055994530942f;
constexpr float kHalfLogTwoPi = 0.91893853320467274178f;

GIGA_HD float softplus(float x) { return x > 15 ? x : std::log1p(std::exp(x)); }

/// log(1 - tanh(u)^2), stable for large |u|: the log-determinant of the squashing (Haarnoja et al. 2018, appendix C).
GIGA_HD float log_squash_slope(float u) { return 2.0f * (kLogTwo - u - softplus(-2.0f * u)); }

/// Log-density of the squashed action tanh(u), where u ~ N(mean, exp(log_std)^2), one dimension.
GIGA_HD float squashed_log_prob(float u, float mean, float log_std) {
  const float e = (u - mean) * std::exp(-log_std);
  return -0.5f * e * e - log_std - kHalfLogTwoPi - log_squash_slope(u);
}

/// What squashing adds to the entropy of u ~ N(mean, std^2), one dimension, and its slopes by the mean and by log std:
/// the mean of log(1 - tanh(u)^2), never above 0. By the trapezoid rule over +-4 deviations, whose error is below 1e-4
/// up to a deviation of 1 and 2e-2 at one of e (the slopes' 3e-4 and 8e-2); coarse beyond, where the slopes still have
/// the right sign. Nothing is drawn, so the gradient has no noise.
struct SquashEntropy {
  float value, by_mean, by_log_std;
};
GIGA_HD SquashEntropy squash_entropy(float mean, float std) {
  constexpr int kEachSide = 5;
  constexpr float kApart = 0.8f;          // deviations
  constexpr float kMiddle = 0.31915588f;  // 1 / sum of exp(-z^2 / 2)
  SquashEntropy sum{0, 0, 0};
  // exp(-z^2 / 2) falls from node to node by a factor that falls by one itself.
  float weight = kMiddle, factor = 0.72614904f, z = 0;  // exp(-kApart^2 / 2)
  GIGA_ROLLED
  for (int k = 0; k <= kEachSide; ++k) {
    GIGA_UNROLL
    for (int side = 0; side < 2; ++side) {
      const float at = side == 0 ? z : -z, u = mean + std * at, far = u < 0 ? -u : u;
      const float q = std::exp(-2.0f * far), tanh = (u < 0 ? q - 1 : 1 - q) / (1 + q);
      const float w = k == 0 ? 0.5f * weight : weight;
      sum.value += w * log_squash_slope(far);
      sum.by_mean -= 2.0f * w * tanh;
      sum.by_log_std -= 2.0f * w * tanh * std * at;
    }
    weight *= factor;
    factor *= 0.52729242f;  // exp(-kApart^2)
    z += kApart;
  }
  return sum;
}

/// Standard normal number k of the action of a row.
GIGA_HD float action_normal(DrawKey& key, const RowDraws& draws, int64_t row, int k) {
  const float u = key.uniform(Draw::action, draws.agent(row), static_cast<uint32_t>(2 * k));
  const float v = key.uniform(Draw::action, draws.agent(row), static_cast<uint32_t>(2 * k + 1));
  return normal_pair(u, v).first;
}

/// Samples a continuous action per row. `pre_tanh_action` keeps u, so that log-probabilities need no inverse of tanh
/// later.
struct SampleGaussian {
  static constexpr int kSize = kActionSize;
  const float* mean;     // [R, 3]
  const float* log_std;  // [3]
  RowDraws draws;
  float* pre_tanh_action;  // [R, 3]; null = not wanted
  float* action;           // [R, 3] in (-1, 1)
  float* log_prob;         // [R]; null = not wanted
  bool greedy = false;

  GIGA_HD void operator()(int64_t row) const { sample(row, mean + row * kSize); }
  /// Of a row whose means lie elsewhere.
  GIGA_HD void sample(int64_t row, const float* row_mean) const {
    DrawKey key = draws.key(row);
    float total = 0;
    for (int k = 0; k < kSize; ++k) {
      const float normal = greedy ? 0.0f : action_normal(key, draws, row, k);
      const float m = row_mean[k];
      const float u = m + std::exp(log_std[k]) * normal;
      total += squashed_log_prob(u, m, log_std[k]);
      action[row * kSize + k] = std::tanh(u);
      if (pre_tanh_action) pre_tanh_action[row * kSize + k] = u;
    }
    if (log_prob) log_prob[row] = total;
  }
};

}  // namespace giga
