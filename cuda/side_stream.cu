#include "cuda/side_stream.hpp"

#include "cuda/check.cuh"

namespace giga {
namespace {

void wait(int index, void* event, void* from, void* to) {
  GIGA_CUDA(cudaSetDevice(index));
  GIGA_CUDA(cudaEventRecord(static_cast<cudaEvent_t>(event), static_cast<cudaStream_t>(from)));
  GIGA_CUDA(cudaStreamWaitEvent(static_cast<cudaStream_t>(to), static_cast<cudaEvent_t>(event)));
}

}  // namespace

SideStream::SideStream(int index, void* main) : index_(index), main_(main) {
  GIGA_CUDA(cudaSetDevice(index));
  cudaStream_t stream;
  cudaEvent_t event;
  GIGA_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  stream_ = stream;
  GIGA_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
  event_ = event;
}

SideStream::~SideStream() {
  cudaEventDestroy(static_cast<cudaEvent_t>(event_));
  cudaStreamDestroy(static_cast<cudaStream_t>(stream_));
}

void SideStream::fork() { wait(index_, event_, main_, stream_); }
void SideStream::join() { wait(index_, event_, stream_, main_); }

}  // namespace giga
