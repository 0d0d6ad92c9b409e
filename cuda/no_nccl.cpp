// Sums over GPUs in a build without NCCL: there are none.
#include "core/error.hpp"
#include "cuda/gpu_sum.hpp"

namespace giga {
namespace {
[[noreturn]] void missing_nccl() {
  throw InputError(
      "this build has no NCCL, by which the GPUs of several ranks add up; install the wheel nvidia-nccl-cu13 beside "
      "LibTorch and build again, or train on one GPU");
}
}  // namespace

bool built_with_nccl() { return false; }
std::string make_gpu_sum_id() { missing_nccl(); }
std::unique_ptr<GpuSum> make_gpu_sum(const std::string&, int, int, int) { missing_nccl(); }

}  // namespace giga
