// SideStream: a GPU stream beside another, for work that may go on at the same time. StreamMark: a place in the work of
// one stream that another waits for.
#pragma once

namespace giga {

class StreamMark {
 public:
  explicit StreamMark(int index);  ///< on that GPU
  ~StreamMark();
  StreamMark(const StreamMark&) = delete;
  StreamMark& operator=(const StreamMark&) = delete;

  /// Behind all that was queued on this stream (a cudaStream_t).
  void set(void* stream);
  /// What is queued on this stream later waits for the place that was set last; for nothing where none was.
  void wait(void* stream) const;

 private:
  int index_;
  void* event_ = nullptr;
};

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
  void *main_, *stream_ = nullptr;
  StreamMark mark_;
};

}  // namespace giga
