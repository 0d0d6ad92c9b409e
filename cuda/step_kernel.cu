// Loading and launching the step that was compiled for a scenario, by the CUDA runtime alone.
#include <cstdlib>

#include "cuda/check.cuh"
#include "cuda/runtime.hpp"
#include "cuda/step_compiler.hpp"
#include "cuda/step_kernel.hpp"

namespace giga {
namespace {

class LoadedStep final : public StepKernel {
 public:
  explicit LoadedStep(const LaunchShape& shape) : shape_(shape) {}
  LoadedStep(const LoadedStep&) = delete;
  LoadedStep& operator=(const LoadedStep&) = delete;
  ~LoadedStep() override {
    if (library_) cudaLibraryUnload(library_);
  }

  /// What went wrong.
  cudaError_t load(const std::string& code) {
    cudaError_t status = cudaLibraryLoadData(&library_, code.data(), nullptr, nullptr, 0, nullptr, nullptr, 0);
    if (status == cudaSuccess) status = cudaLibraryGetKernel(&kernel_, library_, kFixedStepName);
    if (status == cudaSuccess && shape_.shared_bytes > kSharedLimit)
      status = cudaFuncSetAttribute(function(), cudaFuncAttributeMaxDynamicSharedMemorySize,
                                    static_cast<int>(shape_.shared_bytes));
    // Asking for its attributes loads it now, and not while a graph is captured.
    cudaFuncAttributes attributes{};
    if (status == cudaSuccess) status = cudaFuncGetAttributes(&attributes, function());
    if (status != cudaSuccess) cudaGetLastError();  // it is told, and over
    return status;
  }

  void launch(const Launch& k, void* stream) const override {
    Launch fixed = k.with(k.params, shape_);
    void* arguments[] = {&fixed};
    GIGA_CUDA(cudaLaunchKernel(function(), dim3(static_cast<unsigned>(shape_.blocks)),
                               dim3(static_cast<unsigned>(shape_.threads)), arguments, shape_.shared_bytes,
                               static_cast<cudaStream_t>(stream)));
  }

 private:
  const void* function() const { return reinterpret_cast<const void*>(kernel_); }

  const LaunchShape shape_;
  cudaLibrary_t library_ = nullptr;
  cudaKernel_t kernel_ = nullptr;
};

}  // namespace

std::unique_ptr<StepKernel> StepKernel::make(const SimParams& p, int n_worlds, int index, std::string& report) {
  const auto environment = [](const char* name) -> const char* { return std::getenv(name); };
  const KernelCache cache(KernelCache::default_folder(environment));
  const int capability = cuda_device_info(index).compute_capability;
  const Nvrtc nvrtc;
  GIGA_CUDA(cudaSetDevice(index));
  // What was kept and is not taken, by another driver perhaps, is compiled once more.
  for (const bool anew : {false, true}) {
    const CompiledStep compiled = compile_step(p, capability, nvrtc, cache, anew);
    report = compiled.report;
    if (compiled.code.empty()) return nullptr;
    auto kernel = std::make_unique<LoadedStep>(fixed_shape(p, n_worlds));
    const cudaError_t status = kernel->load(compiled.code);
    if (status == cudaSuccess) return kernel;
    report = cat("the GPU does not take what was ", compiled.report, ": ", cudaGetErrorString(status));
    if (!compiled.cached) break;
  }
  return nullptr;
}

}  // namespace giga
