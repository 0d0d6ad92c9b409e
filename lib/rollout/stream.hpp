// The stream on which the work of a run is queued.
#pragma once

#include "core/memory.hpp"

namespace giga {

/// The stream of a GPU on which LibTorch queues its work now (a cudaStream_t); null on the CPU. Simulators and kernels
/// are given it too, so that all work of a run stays in order and nobody waits.
void* current_stream(Device device);

}  // namespace giga
