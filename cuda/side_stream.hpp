// SideStream: a GPU stream beside another, for work that may go on at the same time.
#pragma once

namespace giga {

class SideStream {
 public:
  /// `main`: a cudaStream_t of GPU `index`.
  SideStream(int index, void* main);
  ~SideStream();
  SideStream(const SideStream&) = delete;
  SideStream& operator=(const SideStream&) = delete;

  void* stream() const { return stream_; }
  /// What is queued here later waits for what was queued on the main stream before.
  void fork();
  /// The reverse.
  void join();

 private:
  int index_;
  void *main_, *stream_ = nullptr, *event_ = nullptr;
};

}  // namespace giga
