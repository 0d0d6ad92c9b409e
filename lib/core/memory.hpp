// Owning buffers in host or device memory. Who allocates is a parameter, so that nothing here knows CUDA.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace giga {

/// Where data lives and work runs.
struct Device {
  enum class Kind : uint8_t { cpu, cuda } kind = Kind::cpu;
  int index = 0;  ///< number of the GPU; 0 for the CPU

  bool is_cuda() const { return kind == Kind::cuda; }
  std::string name() const { return is_cuda() ? "cuda:" + std::to_string(index) : "cpu"; }
  bool operator==(const Device&) const = default;
};

/// Allocates, clears and copies memory of one device. Copies to and from the host wait for completion.
class Memory {
 public:
  virtual ~Memory() = default;
  virtual Device device() const = 0;
  virtual void* allocate(size_t bytes) = 0;
  virtual void release(void* p) noexcept = 0;
  virtual void clear(void* p, size_t bytes) = 0;
  virtual void to_host(void* host, const void* device, size_t bytes) = 0;
  virtual void from_host(void* device, const void* host, size_t bytes) = 0;
};

/// Ordinary memory, 64-byte aligned.
Memory& host_memory();

/// `size` elements of T, zeroed at construction, released at destruction. Moves, never copies.
template <class T>
class Buffer {
 public:
  Buffer() = default;
  Buffer(Memory& memory, size_t size) : memory_(&memory), size_(size) {
    if (size_ == 0) return;
    data_ = static_cast<T*>(memory.allocate(size_ * sizeof(T)));
    memory.clear(data_, size_ * sizeof(T));
  }
  Buffer(Memory& memory, const std::vector<T>& values) : Buffer(memory, values.size()) { from_host(values); }
  ~Buffer() { reset(); }
  Buffer(Buffer&& other) noexcept { swap(other); }
  Buffer& operator=(Buffer&& other) noexcept {
    swap(other);
    return *this;
  }

  T* data() const { return data_; }
  size_t size() const { return size_; }
  size_t bytes() const { return size_ * sizeof(T); }
  void clear() {
    if (size_) memory_->clear(data_, bytes());
  }
  std::vector<T> to_host() const {
    std::vector<T> values(size_);
    if (size_) memory_->to_host(values.data(), data_, bytes());
    return values;
  }
  void from_host(const std::vector<T>& values) {
    if (size_) memory_->from_host(data_, values.data(), bytes());
  }

 private:
  void reset() noexcept {
    if (data_) memory_->release(data_);
    data_ = nullptr;
  }
  void swap(Buffer& other) noexcept {
    std::swap(memory_, other.memory_);
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
  }

  Memory* memory_ = nullptr;
  T* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace giga
