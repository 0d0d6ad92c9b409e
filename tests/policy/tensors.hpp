// What the policy tests share: random tensors by seed, and the largest difference of two tensors.
#pragma once

#include <ATen/CPUGeneratorImpl.h>
#include <torch/types.h>

#include "core/parallel_for.hpp"

namespace giga::test {

/// Standard normal numbers, the same for the same seed.
inline at::Tensor random(at::IntArrayRef shape, uint64_t seed) {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  return at::randn(shape, generator, at::TensorOptions().dtype(at::kFloat));
}

inline at::Tensor numbers(const std::vector<float>& values) { return torch::tensor(values); }

inline double worst(const at::Tensor& a, const at::Tensor& b) {
  return (a.detach().to(at::kDouble) - b.detach().to(at::kDouble)).abs().max().item<double>();
}
inline double largest(const at::Tensor& a) { return a.detach().abs().max().item<double>(); }
inline bool same(const at::Tensor& a, const at::Tensor& b) { return at::equal(a.detach(), b.detach()); }

/// Elementwise operations on one thread of the CPU.
inline const ParallelFor& cpu_loop() {
  static const ParallelFor parallel_for(Device{}, 1);
  return parallel_for;
}

}  // namespace giga::test
