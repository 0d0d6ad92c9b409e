// Kernels that begin before the one before them on their stream has ended (programmatic dependent launch): what is
// needed at the start is then there when it does. On GPUs of compute capability 9.0 and more.
#pragma once

#include <optional>

#include "cuda/check.cuh"

namespace giga {

/// Said by all blocks: the next kernel may begin, if it was launched early. It sees nothing of what this one writes
/// before it has called wait_for_last.
__device__ __forceinline__ void let_next_begin() {
#if __CUDA_ARCH__ >= 900
  asm volatile("griddepcontrol.launch_dependents;" ::: "memory");
#endif
}

/// Until the kernel before has ended; at once where this one was not launched early. All that any kernel before it
/// wrote is seen behind it, as long as each of these that was launched early has called it too.
__device__ __forceinline__ void wait_for_last() {
#if __CUDA_ARCH__ >= 900
  asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
}

/// Reads what the kernel before may have written while this one ran: not through the cache for constant numbers, and
/// not before wait_for_last.
__device__ __forceinline__ float read_behind(const float* at) {
  float x;
  asm volatile("ld.global.cg.f32 %0, [%1];" : "=f"(x) : "l"(at) : "memory");
  return x;
}
__device__ __forceinline__ float2 read_behind(const float2* at) {
  float2 two;
  asm volatile("ld.global.cg.v2.f32 {%0, %1}, [%2];" : "=f"(two.x), "=f"(two.y) : "l"(at) : "memory");
  return two;
}

/// Whether a kernel waits at all: code for other GPUs, which a newer one may translate, does not.
template <class Kernel>
bool may_wait(Kernel kernel) {
  cudaFuncAttributes attributes{};
  GIGA_CUDA(cudaFuncGetAttributes(&attributes, kernel));
  return attributes.ptxVersion >= 90;
}

/// Launches a kernel, `early`: if it can wait; with one more attribute or none.
template <class Kernel, class... Arguments>
void launch_kernel(Kernel kernel, bool early, dim3 blocks, int threads, size_t shared_bytes, cudaStream_t stream,
                   std::optional<cudaLaunchAttribute> another, const Arguments&... arguments) {
  cudaLaunchAttribute attributes[2]{};
  unsigned n = 0;
  if (another) attributes[n++] = *another;
  if (early && may_wait(kernel)) {
    attributes[n].id = cudaLaunchAttributeProgrammaticStreamSerialization;
    attributes[n++].val.programmaticStreamSerializationAllowed = 1;
  }
  cudaLaunchConfig_t config{};
  config.gridDim = blocks;
  config.blockDim = static_cast<unsigned>(threads);
  config.dynamicSmemBytes = shared_bytes;
  config.stream = stream;
  config.attrs = attributes;
  config.numAttrs = n;
  GIGA_CUDA(cudaLaunchKernelEx(&config, kernel, arguments...));
}

}  // namespace giga
