// Row operations on the GPU: one thread per row.
#include "cuda/check.cuh"
#include "cuda/rows.hpp"
#include "math/distributions.hpp"
#include "math/es_noise.hpp"
#include "math/gae.hpp"
#include "math/population_actions.hpp"
#include "math/ppo_loss.hpp"
#include "math/scripted.hpp"
#include "math/step_gate.hpp"
#include "math/team_mean.hpp"

namespace giga {
namespace {

constexpr int kThreads = 128;

template <class Op>
__global__ void __launch_bounds__(kThreads) rows_kernel(const __grid_constant__ Op op, int64_t n) {
  const int64_t row = static_cast<int64_t>(blockIdx.x) * kThreads + threadIdx.x;
  if (row < n) op(row);
}

}  // namespace

template <class Op>
void launch_rows(const Op& op, int64_t n, int index, void* stream) {
  GIGA_CUDA(cudaSetDevice(index));
  const auto blocks = static_cast<unsigned>((n + kThreads - 1) / kThreads);
  rows_kernel<<<blocks, kThreads, 0, static_cast<cudaStream_t>(stream)>>>(op, n);
  GIGA_CUDA(cudaGetLastError());
}

template void launch_rows(const SampleCategorical&, int64_t, int, void*);
template void launch_rows(const SampleGaussian&, int64_t, int, void*);
template void launch_rows(const ScriptedActions&, int64_t, int, void*);
template void launch_rows(const Gae&, int64_t, int, void*);
template void launch_rows(const CategoricalLoss&, int64_t, int, void*);
template void launch_rows(const GaussianLoss&, int64_t, int, void*);
template void launch_rows(const ValueLoss&, int64_t, int, void*);
template void launch_rows(const PopulationActions&, int64_t, int, void*);
template void launch_rows(const PopulationScriptsOfAll&, int64_t, int, void*);
template void launch_rows(const PerturbMembers&, int64_t, int, void*);
template void launch_rows(const NoiseMoments&, int64_t, int, void*);
template void launch_rows(const FiniteCheck&, int64_t, int, void*);
template void launch_rows(const StepGate&, int64_t, int, void*);
template void launch_rows(const LivingMean<float>&, int64_t, int, void*);
template void launch_rows(const LivingMean<BFloat16>&, int64_t, int, void*);
template void launch_rows(const LivingMeanGradient<float>&, int64_t, int, void*);
template void launch_rows(const LivingMeanGradient<BFloat16>&, int64_t, int, void*);

}  // namespace giga
