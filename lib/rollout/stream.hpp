// The stream on which the work of a run is queued.
#pragma once

#include "core/memory.hpp"

namespace giga {

/// The stream of a GPU on which LibTorch queues this thread's work (a cudaStream_t); null on the CPU. In the place of
/// the default stream LibTorch gets a work stream (cuda/runtime.hpp). Simulators and kernels are given the same one, so
/// that all work of a run stays in order and nobody waits.
void* current_stream(Device device);

}  // namespace giga
