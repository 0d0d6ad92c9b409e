#include "learn/libtorch_settings.hpp"

#include <ATen/Context.h>
#include <ATen/Parallel.h>
#include <c10/core/AllocatorConfig.h>
#include <torch/types.h>

#include <cstdlib>

#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Lets LibTorch's allocator grow its segments in place: with segments of a fixed size it held up to 31 % more than
/// was in use at the peak, with growing ones up to 17 % (ten runs on an H200), at the same speed. A setting of the
/// whole process; the user's own has precedence.
void let_segments_grow() {
  if (std::getenv("PYTORCH_ALLOC_CONF") || std::getenv("PYTORCH_CUDA_ALLOC_CONF")) return;
  c10::CachingAllocator::setAllocatorSettings("expandable_segments:True");
}

}  // namespace

void set_up_libtorch(const TrainConfig& config, Device device) {
  // Backward passes run on a thread of LibTorch's own. Without a kernel before the first matrix product there, cuBLAS
  // warns of a missing CUDA context.
  const at::Tensor x = at::ones({1}, at::TensorOptions().device(torch_device(device))).set_requires_grad(true);
  (x * x).backward();

  let_segments_grow();
  // bf16 is done by casts and needs no setting; products of numbers in half precision are exact in TF32.
  const bool tf32 = config.precision == Precision::tf32 || config.precision == Precision::fp16;
  at::globalContext().setAllowTF32CuBLAS(tf32);
  // Convolutions: algorithms that add up in a fixed order, chosen by rule. Those that benchmarks choose can be others
  // in the next run, and a resumed run would not repeat.
  at::globalContext().setAllowTF32CuDNN(tf32);
  at::globalContext().setDeterministicCuDNN(true);
  at::globalContext().setBenchmarkCuDNN(false);
  if (config.n_threads > 0) at::set_num_threads(config.n_threads);
}

}  // namespace giga
