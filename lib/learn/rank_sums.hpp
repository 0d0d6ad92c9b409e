// RankSums: how a learner adds up over ranks. On CPUs by what ranks tell each other; on GPUs by NCCL, where a rank that
// is gone would make the others wait for ever, so that they are watched meanwhile.
#pragma once

#include <atomic>
#include <memory>

#include "core/memory.hpp"
#include "core/named_array.hpp"
#include "cuda/gpu_sum.hpp"
#include "policy/sum_over_ranks.hpp"
#include "ranks/ranks.hpp"

namespace giga {

class RankSums {
 public:
  /// All ranks make one at the same time. `ranks` must outlive it.
  RankSums(Ranks& ranks, Device device);
  ~RankSums();
  RankSums(const RankSums&) = delete;
  RankSums& operator=(const RankSums&) = delete;

  /// For as long as this lives. On a GPU only between begin() and end().
  SumOverRanks over_all();
  /// The same for numbers of the host; waits for them.
  void add_host(const at::Tensor& x);
  /// The tensors [n] of all ranks, those of rank 0 first: [ranks n] on the same device. On a GPU queued, between
  /// begin() and end().
  at::Tensor gather(const at::Tensor& mine);
  /// The rows of all ranks in the place of this one's, those of rank 0 first; every rank has as many.
  void gather_rows(NamedArray& array);

  /// Around an update.
  void begin();
  /// Once the device has done it all: throws Error where a rank was missing, and what was computed has no meaning.
  void end();

 private:
  void connect();
  void add(const at::Tensor& x, void* stream);
  void stop_watching() noexcept;

  Ranks& ranks_;
  const Device device_;
  std::unique_ptr<GpuSum> gpus_;                 // null on a CPU
  std::atomic<GpuSum*> watched_gpus_ = nullptr;  // the same for the thread that watches, once it is whole
  std::atomic<int64_t> begun_ = 0;
  bool watched_ = false;
};

}  // namespace giga
