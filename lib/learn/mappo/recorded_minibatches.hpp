// RecordedMinibatches: LibTorch's work for a minibatch, recorded once as a CUDA graph. A minibatch of a small network
// is some hundred kernels of a few microseconds each: queued one by one they wait for the host.
#pragma once

#include <ATen/core/Tensor.h>

#include <functional>
#include <map>
#include <memory>

#include "rollout/torch_recorder.hpp"

namespace giga {

class RecordedMinibatches {
 public:
  /// Queues what is learned from states [L, B], the minibatch `number` [1] of the update. Whatever differs between
  /// minibatches or updates it reads from these two, or from memory of the device that stays where it is.
  using Learn = std::function<void(const at::Tensor& states, const float* number)>;

  explicit RecordedMinibatches(std::shared_ptr<TorchRecorder> recorder) : recorder_(std::move(recorder)) {}

  /// Learns from these states, as a graph once `warm` was true for as many: all minibatches have been learned from
  /// before, kernel by kernel.
  void learn(const at::Tensor& states, const at::Tensor& number, bool warm, const Learn& learn);

 private:
  struct Minibatch {
    at::Tensor states, number;           // where the graph reads them
    std::unique_ptr<RecordedWork> work;  // null: not recorded yet
  };
  std::shared_ptr<TorchRecorder> recorder_;
  std::map<int64_t, Minibatch> by_size_;  // minibatches of an epoch differ by one state at most
};

}  // namespace giga
