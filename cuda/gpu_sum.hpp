// GpuSum: sums over the GPUs of several processes, by NCCL, and what else they tell each other.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace giga {

/// Each process has one GPU. All call the same functions in the same order.
class GpuSum {
 public:
  virtual ~GpuSum() = default;

  /// Adds n numbers up over all processes, in place; queued on `stream` (a cudaStream_t). All get the same bits, and
  /// the same processes on the same GPUs the same ones each time. Throws Error where that fails at once.
  virtual void add(float* x, int64_t n, void* stream) = 0;
  virtual void add(double* x, int64_t n, void* stream) = 0;
  /// The bytes of all processes, in their order: n of each, from `mine` to `all` [processes x n], both on the GPU.
  virtual void gather(const uint8_t* mine, uint8_t* all, int64_t n, void* stream) = 0;
  /// What has failed since, as a cut connection; empty where nothing has. From any thread.
  virtual std::string trouble() = 0;
  /// Ends all sums that are queued, without a result, so that nobody waits for a process that is gone. From any thread;
  /// later sums throw Error.
  virtual void abort() noexcept = 0;
};

/// Whether this build has NCCL.
bool built_with_nccl();

/// One of the processes makes it, and all need it; 128 bytes.
std::string make_gpu_sum_id();
/// Waits for the others. `index`: of this process's GPU.
std::unique_ptr<GpuSum> make_gpu_sum(const std::string& id, int rank, int size, int index);

}  // namespace giga
