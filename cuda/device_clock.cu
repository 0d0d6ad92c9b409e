// The clock of a GPU.
#include "cuda/device_clock.hpp"

#include "cuda/check.cuh"

namespace giga {
namespace {

class CudaClock final : public DeviceClock {
 public:
  CudaClock(int index, void* stream) : stream_(static_cast<cudaStream_t>(stream)) {
    GIGA_CUDA(cudaSetDevice(index));
    for (cudaEvent_t& event : events_) GIGA_CUDA(cudaEventCreate(&event));
  }
  ~CudaClock() override {
    for (cudaEvent_t event : events_) cudaEventDestroy(event);
  }

  void mark(int k) override { GIGA_CUDA(cudaEventRecord(events_[k], stream_)); }
  double seconds(int from, int to) const override {
    float milliseconds = 0;
    if (cudaEventElapsedTime(&milliseconds, events_[from], events_[to]) == cudaSuccess) return milliseconds * 1e-3;
    cudaGetLastError();
    return 0;
  }

 private:
  cudaStream_t stream_;
  cudaEvent_t events_[kMarks];
};

}  // namespace

std::unique_ptr<DeviceClock> make_cuda_clock(int index, void* stream) {
  return std::make_unique<CudaClock>(index, stream);
}

}  // namespace giga
