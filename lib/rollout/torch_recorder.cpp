#include "rollout/torch_recorder.hpp"

#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDACachingAllocator.h>
#include <c10/cuda/CUDAStream.h>

#include "core/error.hpp"

namespace giga {
namespace {

class Graph final : public RecordedWork {
 public:
  Graph() = default;
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;
  ~Graph() override { cudaStreamSynchronize(c10::cuda::getCurrentCUDAStream()); }  // it may still run

  void capture(c10::MempoolId_t pool, const std::function<void()>& work) {
    // Other threads may allocate meanwhile.
    graph_.capture_begin(pool, cudaStreamCaptureModeThreadLocal);
    try {
      work();
    } catch (...) {
      try {
        graph_.capture_end();
      } catch (const std::exception&) {  // the first failure is the one to be told
      }
      throw;
    }
    graph_.capture_end();
  }
  void queue() override { graph_.replay(); }

 private:
  at::cuda::CUDAGraph graph_;
};

class CudaRecorder final : public TorchRecorder {
 public:
  std::unique_ptr<RecordedWork> record(const std::function<void()>& work) override {
    // A graph's tensors lie in memory of its own. What the work took while it was queued kernel by kernel would be kept
    // beside it.
    c10::cuda::CUDACachingAllocator::emptyCache();
    auto graph = std::make_unique<Graph>();
    try {
      graph->capture(pool_, work);
    } catch (const c10::Error& e) {
      throw Error(cat("LibTorch cannot record a CUDA graph: ", e.what_without_backtrace()));
    }
    return graph;
  }

 private:
  const c10::MempoolId_t pool_ = at::cuda::graph_pool_handle();
};

}  // namespace

std::shared_ptr<TorchRecorder> make_torch_recorder(Device device) {
  return device.is_cuda() ? std::make_shared<CudaRecorder>() : nullptr;
}

}  // namespace giga
