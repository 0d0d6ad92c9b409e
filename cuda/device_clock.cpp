// The clock of the CPU, and the choice by device.
#include "cuda/device_clock.hpp"

#include <array>
#include <chrono>

namespace giga {
namespace {

class HostClock final : public DeviceClock {
 public:
  void mark(int k) override { marks_.at(static_cast<size_t>(k)) = Clock::now(); }
  double seconds(int from, int to) const override {
    return std::chrono::duration<double>(marks_.at(static_cast<size_t>(to)) - marks_.at(static_cast<size_t>(from)))
        .count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::array<Clock::time_point, kMarks> marks_ = {};
};

}  // namespace

std::unique_ptr<DeviceClock> make_device_clock(Device device, void* stream) {
  if (device.is_cuda()) return make_cuda_clock(device.index, stream);
  return std::make_unique<HostClock>();
}

}  // namespace giga
