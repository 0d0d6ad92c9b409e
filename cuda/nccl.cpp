// Sums over GPUs by NCCL itself, and not by LibTorch's ProcessGroupNCCL: that one puts its sums on streams of its own,
// which costs two events each, and ends a process by its own rules where a rank is gone.
#include <nccl.h>

#include <chrono>
#include <cstring>
#include <mutex>

#include "core/error.hpp"
#include "cuda/check.cuh"
#include "cuda/gpu_sum.hpp"

namespace giga {
namespace {

void expect_nccl(ncclResult_t result, ncclComm_t comm) {
  if (result == ncclSuccess) return;
  const char* more = ncclGetLastError(comm);
  throw Error(cat("NCCL: ", ncclGetErrorString(result), more && *more ? cat(" (", more, ")") : ""));
}

class NcclSum final : public GpuSum {
 public:
  NcclSum(const std::string& id, int rank, int size, int index) {
    ncclUniqueId unique;
    GIGA_CHECK(id.size() == sizeof unique, "an id of ", id.size(), " bytes");
    std::memcpy(&unique, id.data(), sizeof unique);
    GIGA_CUDA(cudaSetDevice(index));
    // One block: messages are small, and the kernels of gradients leave it one multiprocessor.
    ncclConfig_t config = NCCL_CONFIG_INITIALIZER;
    config.minCTAs = config.maxCTAs = 1;
    expect_nccl(ncclCommInitRankConfig(&comm_, size, unique, rank, &config), nullptr);
  }
  // Not ncclCommDestroy, which waits for others that may be gone. Nothing is queued any more where a run is done.
  ~NcclSum() override { abort(); }

  void add(float* x, int64_t n, void* stream) override { reduce(x, n, ncclFloat, stream); }
  void add(double* x, int64_t n, void* stream) override { reduce(x, n, ncclDouble, stream); }
  void gather(const uint8_t* mine, uint8_t* all, int64_t n, void* stream) override {
    const std::lock_guard lock(mutex_);
    expect_not_aborted();
    expect_nccl(ncclAllGather(mine, all, static_cast<size_t>(n), ncclUint8, comm_, static_cast<cudaStream_t>(stream)),
                comm_);
  }

  std::string trouble() override {
    const std::unique_lock lock(mutex_, kPatience);
    ncclResult_t result = ncclSuccess;
    if (!lock || !comm_ || ncclCommGetAsyncError(comm_, &result) != ncclSuccess) return "";
    if (result == ncclSuccess || result == ncclInProgress) return "";
    const char* more = ncclGetLastError(comm_);
    return cat("NCCL: ", ncclGetErrorString(result), more && *more ? cat(" (", more, ")") : "");
  }

  void abort() noexcept override {
    const std::unique_lock lock(mutex_, kPatience);
    if (!lock || !comm_) return;  // a call hangs: the process has to be ended
    ncclCommAbort(comm_);
    comm_ = nullptr;
  }

 private:
  static constexpr std::chrono::seconds kPatience{2};

  void expect_not_aborted() const {
    if (!comm_) throw Error("the sums over GPUs have been given up");
  }
  void reduce(void* x, int64_t n, ncclDataType_t type, void* stream) {
    const std::lock_guard lock(mutex_);
    expect_not_aborted();
    expect_nccl(ncclAllReduce(x, x, static_cast<size_t>(n), type, ncclSum, comm_, static_cast<cudaStream_t>(stream)),
                comm_);
  }

  std::timed_mutex mutex_;
  ncclComm_t comm_ = nullptr;  // null: aborted
};

}  // namespace

bool built_with_nccl() { return true; }

std::string make_gpu_sum_id() {
  ncclUniqueId id;
  expect_nccl(ncclGetUniqueId(&id), nullptr);
  return {reinterpret_cast<const char*>(&id), sizeof id};
}

std::unique_ptr<GpuSum> make_gpu_sum(const std::string& id, int rank, int size, int index) {
  return std::make_unique<NcclSum>(id, rank, size, index);
}

}  // namespace giga
