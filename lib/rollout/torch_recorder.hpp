// TorchRecorder: records what LibTorch queues on a GPU, as CUDA graphs.
#pragma once

#include <functional>
#include <memory>

#include "core/memory.hpp"
#include "sim/recorded_work.hpp"

namespace giga {

class TorchRecorder {
 public:
  virtual ~TorchRecorder() = default;
  /// What `work` queues on LibTorch's stream, forward and backward; nothing of it is done. It must not wait, nor copy
  /// from or to the host, and all of it must have run before, because the first run chooses kernels and loads them.
  /// Tensors that it makes lie in memory which all records of this recorder share: their numbers are gone once another
  /// one is queued. Throws Error where CUDA refuses.
  virtual std::unique_ptr<RecordedWork> record(const std::function<void()>& work) = 0;
};

/// Null where nothing can be recorded: on a CPU.
std::shared_ptr<TorchRecorder> make_torch_recorder(Device device);

}  // namespace giga
