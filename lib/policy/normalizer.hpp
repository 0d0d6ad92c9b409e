// RunningNorm: normalises observations and value targets by running moments of the data.
#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "core/named_array.hpp"
#include "policy/sum_over_ranks.hpp"

namespace giga {

/// What a deviation is before anything was taken in, and the least that it may become.
struct DeviationLimits {
  double first = 1;
  double least = 0.01;
  double least_of_mean = 0;  ///< the same as a share of the mean
};
/// Of observations, which have the scale of a world.
constexpr DeviationLimits kObservationDeviation{};
/// Of values, whose scale is that of rewards: any. Before the first rewards a critic knows nothing, and its values
/// count 0; else its first noise would be taken for returns wherever rewards are smaller. Below a thousandth of the
/// mean the rounding of moments is larger than the deviation.
constexpr DeviationLimits kValueDeviation{.first = 0, .least = 1e-10, .least_of_mean = 1e-3};

/// Mean and standard deviation as exponential moving averages with bias correction (ValueNorm of Yu et al. 2022), of
/// scalars (`size` 1) or per feature. Everything stays on the device.
class RunningNorm {
 public:
  RunningNorm() = default;
  /// `beta` = share kept per update; 0 < beta < 1.
  RunningNorm(int64_t size, double beta, at::Device device, const DeviationLimits& deviation = kObservationDeviation);

  /// Takes in the rows of x [R, size] whose weight [R] is 1, not those of weight 0, of all ranks. No effect if all are
  /// 0.
  void update(const at::Tensor& x, const at::Tensor& weight, const SumOverRanks& sum = {});
  /// The same in two steps, between which the moments are added up over the ranks.
  struct Moments {
    at::Tensor mean, squares;  // [size] the share of these rows in those of all
  };
  /// `count` [] of the rows with weight 1, of all ranks.
  static Moments moments(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& count);
  void take(const Moments& moments, const at::Tensor& count);
  /// (x - mean) / std, clamped to +- kNormalizedLimit.
  at::Tensor apply(const at::Tensor& x) const { return normalized(x, mean_, std_); }
  /// The same with given moments.
  static at::Tensor normalized(const at::Tensor& x, const at::Tensor& mean, const at::Tensor& std);

  const at::Tensor& mean() const { return mean_; }  // [size]
  const at::Tensor& std() const { return std_; }    // [size]

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  double beta_ = 0;
  DeviationLimits deviation_;
  at::Tensor sum_, sum_squares_;  // [size] averages before bias correction
  at::Tensor weight_;             // [1] 1 - beta^updates
  at::Tensor mean_, std_;         // [size] derived
};

}  // namespace giga
