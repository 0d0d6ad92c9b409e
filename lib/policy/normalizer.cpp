#include "policy/normalizer.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include "policy/config.hpp"
#include "policy/parameters.hpp"

namespace giga {

RunningNorm::RunningNorm(int64_t size, double beta, at::Device device, const DeviationLimits& deviation)
    : beta_(beta), deviation_(deviation) {
  const auto options = at::TensorOptions().dtype(at::kFloat).device(device);
  sum_ = at::zeros({size}, options);
  sum_squares_ = at::zeros({size}, options);
  weight_ = at::zeros({1}, options);
  mean_ = at::zeros({size}, options);
  std_ = at::full({size}, deviation.first, options);
}

void RunningNorm::update(const at::Tensor& x, const at::Tensor& weight, const SumOverRanks& sum) {
  at::NoGradGuard no_grad;
  const at::Tensor count = weight.sum();
  sum(count);
  const Moments m = moments(x, weight, count);
  sum.together({m.mean, m.squares});
  take(m, count);
}

RunningNorm::Moments RunningNorm::moments(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& count) {
  at::NoGradGuard no_grad;
  // The weights, 0 and 1, are exact in TF32 too; shares, rounded there, would make means and squares differ by more
  // than a small deviation.
  const at::Tensor row = weight.unsqueeze(0), rows = count.clamp_min(1);  // [1, R]
  return {at::mm(row, x).squeeze(0) / rows, at::mm(row, x.square()).squeeze(0) / rows};
}

void RunningNorm::take(const Moments& m, const at::Tensor& count) {
  at::NoGradGuard no_grad;
  const at::Tensor present = (count > 0).to(at::kFloat);
  const at::Tensor step = present * (1.0 - beta_);
  sum_.add_(step * (m.mean - sum_));
  sum_squares_.add_(step * (m.squares - sum_squares_));
  weight_.add_(step * (1.0 - weight_));
  const at::Tensor correction = weight_.clamp_min(1e-8);
  mean_.copy_(sum_ / correction);
  const at::Tensor square = mean_.square(), least = square * (deviation_.least_of_mean * deviation_.least_of_mean) +
                                                    deviation_.least * deviation_.least;
  std_.copy_(at::where(weight_ > 0, at::maximum(sum_squares_ / correction - square, least).sqrt(), deviation_.first));
}

at::Tensor RunningNorm::normalized(const at::Tensor& x, const at::Tensor& mean, const at::Tensor& std) {
  return ((x - mean) / std).clamp(-kNormalizedLimit, kNormalizedLimit);
}

void RunningNorm::save(const std::string& prefix, NamedArrays& out) const {
  out.push_back(to_array(prefix + "sum", sum_));
  out.push_back(to_array(prefix + "sum_squares", sum_squares_));
  out.push_back(to_array(prefix + "weight", weight_));
  out.push_back(to_array(prefix + "mean", mean_));
  out.push_back(to_array(prefix + "std", std_));
}

void RunningNorm::load(const std::string& prefix, const NamedArrays& in) {
  from_array(find_array(in, prefix + "sum"), sum_);
  from_array(find_array(in, prefix + "sum_squares"), sum_squares_);
  from_array(find_array(in, prefix + "weight"), weight_);
  from_array(find_array(in, prefix + "mean"), mean_);
  from_array(find_array(in, prefix + "std"), std_);
}

}  // namespace giga
