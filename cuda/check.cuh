// GIGA_CUDA: throws giga::DeviceError with the call and CUDA's message unless a runtime call succeeds. What launches
// ask.
#pragma once

#include <cuda_runtime.h>

#include "core/error.hpp"

#define GIGA_CUDA(call)                                                                            \
  do {                                                                                             \
    const cudaError_t giga_status = (call);                                                        \
    if (giga_status != cudaSuccess)                                                                \
      throw ::giga::DeviceError(                                                                   \
          ::giga::cat(__FILE__, ":", __LINE__, ": " #call ": ", cudaGetErrorString(giga_status))); \
  } while (false)

namespace giga {

/// Multiprocessors of a GPU.
inline int multiprocessors(int device) {
  int count = 0;
  GIGA_CUDA(cudaDeviceGetAttribute(&count, cudaDevAttrMultiProcessorCount, device));
  return count;
}

}  // namespace giga
