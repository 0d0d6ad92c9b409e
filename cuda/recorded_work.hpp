// Recording the work of a GPU stream, as a CUDA graph.
#pragma once

#include <functional>
#include <memory>

#include "sim/recorded_work.hpp"

namespace giga {

/// What `work` queues on `stream` (a cudaStream_t of GPU `index`, not the default stream) and on those that
/// Recording::side_by_side hands out, at most `most_beside` at a time; nothing of it is done. It may queue kernels and
/// clears, but must not wait, copy from or to the host, or allocate on the GPU. Each of its kernels must have run
/// before: else it would be loaded in the middle. Throws DeviceError where CUDA refuses, whoever asked; what else
/// `work` throws goes through.
std::unique_ptr<RecordedWork> record_work(int index, void* stream, size_t most_beside,
                                          const std::function<void(Recording&)>& work);

}  // namespace giga
