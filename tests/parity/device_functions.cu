// Pure functions on the GPU: one thread per value.
#include "core/memory.hpp"
#include "cuda/check.cuh"
#include "cuda/runtime.hpp"
#include "parity/device_functions.cuh"

namespace giga::test {
namespace {

constexpr int kThreads = 128;

__global__ void functions_kernel(const float* angles, int n, float* out) {
  const int k = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
  if (k < n) evaluate_functions(angles[k], out + static_cast<int64_t>(k) * kNFunctions);
}

__global__ void draws_kernel(uint64_t seed, int n_worlds, uint32_t step, float* out) {
  const int world = static_cast<int>(blockIdx.x * kThreads + threadIdx.x);
  if (world < n_worlds)
    evaluate_draws(seed, static_cast<uint32_t>(world), step, out + static_cast<int64_t>(world) * kDrawsPerWorld);
}

int blocks_for(int n) { return (n + kThreads - 1) / kThreads; }

}  // namespace

std::vector<float> functions_on_gpu(const std::vector<float>& angles) {
  const Buffer<float> in(cuda_memory(0), angles), out(cuda_memory(0), angles.size() * kNFunctions);
  const int n = static_cast<int>(angles.size());
  functions_kernel<<<blocks_for(n), kThreads>>>(in.data(), n, out.data());
  GIGA_CUDA(cudaGetLastError());
  return out.to_host();
}

std::vector<float> draws_on_gpu(uint64_t seed, int n_worlds, uint32_t step) {
  const Buffer<float> out(cuda_memory(0), static_cast<size_t>(n_worlds) * kDrawsPerWorld);
  draws_kernel<<<blocks_for(n_worlds), kThreads>>>(seed, n_worlds, step, out.data());
  GIGA_CUDA(cudaGetLastError());
  return out.to_host();
}

}  // namespace giga::test
