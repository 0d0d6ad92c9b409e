// Devices, memory and sensors of the CUDA runtime.
#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <mutex>

#include "cuda/check.cuh"
#include "cuda/runtime.hpp"
#include "cuda/sensors.hpp"

namespace giga {
namespace {

class CudaMemory final : public Memory {
 public:
  explicit CudaMemory(int index) : index_(index) {}
  Device device() const override { return {Device::Kind::cuda, index_}; }
  void* allocate(size_t bytes) override {
    GIGA_CUDA(cudaSetDevice(index_));
    void* p = nullptr;
    if (const cudaError_t status = cudaMalloc(&p, bytes); status != cudaSuccess) {
      cudaGetLastError();
      if (status != cudaErrorMemoryAllocation) GIGA_CUDA(status);  // what a kernel did before
      size_t free = 0, total = 0;
      cudaMemGetInfo(&free, &total);
      throw Error(
          cat("out of GPU memory: ", bytes >> 20, " MiB wanted, ", free >> 20, " of ", total >> 20, " MiB free"));
    }
    return p;
  }
  void release(void* p) noexcept override { cudaFree(p); }
  void clear(void* p, size_t bytes) override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaMemset(p, 0, bytes));
  }
  void to_host(void* host, const void* device, size_t bytes) override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaMemcpy(host, device, bytes, cudaMemcpyDeviceToHost));
  }
  void from_host(void* device, const void* host, size_t bytes) override {
    GIGA_CUDA(cudaSetDevice(index_));
    GIGA_CUDA(cudaMemcpy(device, host, bytes, cudaMemcpyHostToDevice));
  }

 private:
  int index_;
};

std::string pci_bus_id(int index) {
  char text[32];
  GIGA_CUDA(cudaDeviceGetPCIBusId(text, sizeof text, index));
  return text;
}

}  // namespace

bool built_with_cuda() { return true; }

int cuda_device_count() {
  int count = 0;
  // Without a driver or a GPU every call fails; that means none, and the error is cleared.
  if (cudaGetDeviceCount(&count) != cudaSuccess) {
    cudaGetLastError();
    return 0;
  }
  return count;
}

GpuInfo cuda_device_info(int index) {
  cudaDeviceProp properties{};
  GIGA_CUDA(cudaGetDeviceProperties(&properties, index));
  GpuInfo info;
  info.name = properties.name;
  info.compute_capability = properties.major * 10 + properties.minor;
  GIGA_CUDA(cudaSetDevice(index));
  GIGA_CUDA(cudaMemGetInfo(&info.memory_free, &info.memory_total));
  GIGA_CUDA(cudaDriverGetVersion(&info.driver_version));
  GIGA_CUDA(cudaRuntimeGetVersion(&info.runtime_version));
  return info;
}

double cuda_copy_rate(int index) {
  constexpr size_t kBytes = size_t{1} << 28;  // beyond all caches
  constexpr int kCopies = 10;
  Buffer<char> from(cuda_memory(index), kBytes), to(cuda_memory(index), kBytes);
  cudaEvent_t start, end;
  GIGA_CUDA(cudaEventCreate(&start));
  GIGA_CUDA(cudaEventCreate(&end));
  float best = std::numeric_limits<float>::infinity();
  for (int k = 0; k < kCopies; ++k) {
    float milliseconds = 0;
    GIGA_CUDA(cudaEventRecord(start));
    GIGA_CUDA(cudaMemcpyAsync(to.data(), from.data(), kBytes, cudaMemcpyDeviceToDevice));
    GIGA_CUDA(cudaEventRecord(end));
    GIGA_CUDA(cudaEventSynchronize(end));
    GIGA_CUDA(cudaEventElapsedTime(&milliseconds, start, end));
    best = std::min(best, milliseconds);
  }
  GIGA_CUDA(cudaEventDestroy(start));
  GIGA_CUDA(cudaEventDestroy(end));
  return 2 * static_cast<double>(kBytes) / (static_cast<double>(best) * 1e-3);
}

Memory& cuda_memory(int index) {
  static std::array<std::unique_ptr<CudaMemory>, 64> memories;  // handles without state, one per device
  static std::mutex mutex;
  GIGA_CHECK(index >= 0 && index < static_cast<int>(memories.size()), "device ", index);
  std::lock_guard lock(mutex);
  auto& memory = memories[static_cast<size_t>(index)];
  if (!memory) memory = std::make_unique<CudaMemory>(index);
  return *memory;
}

void* work_stream(int index) {
  static std::array<cudaStream_t, 64> streams{};  // handles without state, one per device
  static std::mutex mutex;
  GIGA_CHECK(index >= 0 && index < static_cast<int>(streams.size()), "device ", index);
  std::lock_guard lock(mutex);
  cudaStream_t& stream = streams[static_cast<size_t>(index)];
  if (!stream) {
    GIGA_CUDA(cudaSetDevice(index));
    GIGA_CUDA(cudaStreamCreate(&stream));  // not cudaStreamNonBlocking: the default stream waits for it
  }
  return stream;
}

GpuSensors::GpuSensors(int index) : index_(index), thermometer_(pci_bus_id(index)) {}

GpuReading GpuSensors::read() const {
  int before = 0;
  GIGA_CUDA(cudaGetDevice(&before));
  GIGA_CUDA(cudaSetDevice(index_));
  size_t free = 0, total = 0;
  const cudaError_t status = cudaMemGetInfo(&free, &total);
  GIGA_CUDA(cudaSetDevice(before));
  GIGA_CUDA(status);
  return {static_cast<int64_t>(total - free), static_cast<int64_t>(total), thermometer_.read()};
}

}  // namespace giga
