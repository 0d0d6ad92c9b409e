#include "cuda/recorded_work.hpp"

#include <deque>
#include <exception>
#include <memory>
#include <utility>

#include "cuda/check.cuh"
#include "cuda/side_stream.hpp"

namespace giga {
namespace {

/// A graph that is ready to run on its stream.
class Graph final : public RecordedWork {
 public:
  Graph(cudaStream_t stream, cudaGraph_t graph) : stream_(stream) {
    GIGA_CUDA(cudaEventCreateWithFlags(&done_, cudaEventDisableTiming));
    const cudaError_t status = cudaGraphInstantiate(&graph_, graph, 0);
    if (status != cudaSuccess) cudaEventDestroy(done_);
    GIGA_CUDA(status);
  }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;
  ~Graph() override {
    if (done_) cudaEventSynchronize(done_);  // it may still run
    if (done_) cudaEventDestroy(done_);
    cudaGraphExecDestroy(graph_);
  }
  void queue() override {
    GIGA_CUDA(cudaGraphLaunch(graph_, stream_));
    GIGA_CUDA(cudaEventRecord(done_, stream_));
  }

 private:
  cudaStream_t stream_;
  cudaGraphExec_t graph_ = nullptr;
  cudaEvent_t done_ = nullptr;  // after it was queued last
};

class Capture final : public Recording {
 public:
  Capture(int index, void* stream, size_t most_beside) : stream_(stream) {
    for (size_t k = 1; k < most_beside; ++k) beside_.emplace_back(index, stream);
  }
  void side_by_side(size_t n, const std::function<void(size_t k, void* stream)>& queue) override {
    GIGA_CHECK(n <= beside_.size() + 1, n, " at a time, room for ", beside_.size() + 1);
    for (size_t k = 1; k < n; ++k) beside_[k - 1].fork();
    for (size_t k = 0; k < n; ++k) queue(k, k == 0 ? stream_ : beside_[k - 1].stream());
    for (size_t k = 1; k < n; ++k) beside_[k - 1].join();
  }

 private:
  void* stream_;
  std::deque<SideStream> beside_;
};

struct DestroyGraph {
  void operator()(cudaGraph_t graph) const { cudaGraphDestroy(graph); }
};

}  // namespace

std::unique_ptr<RecordedWork> record_work(int index, void* stream, size_t most_beside,
                                          const std::function<void(Recording&)>& work) {
  GIGA_CUDA(cudaSetDevice(index));
  Capture capture(index, stream, most_beside);  // its streams are made before the capture begins
  const auto main = static_cast<cudaStream_t>(stream);
  GIGA_CUDA(cudaStreamBeginCapture(main, cudaStreamCaptureModeThreadLocal));
  cudaGraph_t captured = nullptr;
  const auto end = [&] {
    const cudaError_t status = cudaStreamEndCapture(main, &captured);
    return std::pair(status, std::unique_ptr<std::remove_pointer_t<cudaGraph_t>, DestroyGraph>(captured));
  };
  try {
    work(capture);
    const auto [status, graph] = end();
    GIGA_CUDA(status);
    return std::make_unique<Graph>(main, graph.get());
  } catch (const std::exception& e) {
    // Whoever goes on without it finds the stream, and the runtime's last error, as if nothing had been tried.
    cudaStreamCaptureStatus still = cudaStreamCaptureStatusNone;
    cudaStreamIsCapturing(main, &still);
    if (still != cudaStreamCaptureStatusNone) end();
    cudaGetLastError();
    // CUDA ends a capture itself where it refuses a call, of LibTorch too, which has exceptions of its own.
    if (still == cudaStreamCaptureStatusInvalidated) throw DeviceError(e.what());
    throw;
  }
}

}  // namespace giga
