#include "cuda/side_stream.hpp"

#include "cuda/check.cuh"

namespace giga {

StreamMark::StreamMark(int index) : index_(index) {
  GIGA_CUDA(cudaSetDevice(index));
  cudaEvent_t event;
  GIGA_CUDA(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
  event_ = event;
}

StreamMark::~StreamMark() { cudaEventDestroy(static_cast<cudaEvent_t>(event_)); }

void StreamMark::set(void* stream) {
  GIGA_CUDA(cudaSetDevice(index_));
  GIGA_CUDA(cudaEventRecord(static_cast<cudaEvent_t>(event_), static_cast<cudaStream_t>(stream)));
}

void StreamMark::wait(void* stream) const {
  GIGA_CUDA(cudaSetDevice(index_));
  GIGA_CUDA(cudaStreamWaitEvent(static_cast<cudaStream_t>(stream), static_cast<cudaEvent_t>(event_)));
}

SideStream::SideStream(int index, void* main) : main_(main), mark_(index) {
  cudaStream_t stream;
  GIGA_CUDA(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
  stream_ = stream;
}

SideStream::~SideStream() { cudaStreamDestroy(static_cast<cudaStream_t>(stream_)); }

void SideStream::fork() {
  mark_.set(main_);
  mark_.wait(stream_);
}

void SideStream::join() {
  mark_.set(stream_);
  mark_.wait(main_);
}

}  // namespace giga
