#include "core/memory.hpp"

#include <cstring>
#include <new>

namespace giga {
namespace {

class HostMemory final : public Memory {
 public:
  Device device() const override { return {}; }
  void* allocate(size_t bytes) override { return ::operator new(bytes, kAlignment); }
  void release(void* p) noexcept override { ::operator delete(p, kAlignment); }
  void clear(void* p, size_t bytes) override { std::memset(p, 0, bytes); }
  void to_host(void* host, const void* device, size_t bytes) override { std::memcpy(host, device, bytes); }
  void from_host(void* device, const void* host, size_t bytes) override { std::memcpy(device, host, bytes); }

 private:
  static constexpr std::align_val_t kAlignment{64};
};

}  // namespace

Memory& host_memory() {
  static HostMemory memory;  // has no state
  return memory;
}

}  // namespace giga
