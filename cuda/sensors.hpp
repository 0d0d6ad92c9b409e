// GpuSensors: memory and temperature of a GPU while a program runs on it.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>

namespace giga {

struct GpuReading {
  int64_t memory_used = 0, memory_total = 0;                      ///< bytes, of all processes on the GPU
  double temperature = std::numeric_limits<double>::quiet_NaN();  ///< degrees Celsius; NaN where it cannot be had
};

/// The temperature of a GPU by NVML, which comes with the driver and is loaded when it is there: nothing links to it.
class GpuThermometer {
 public:
  /// `pci_bus_id` as CUDA gives it ("0000:1B:00.0"), since NVML and CUDA number GPUs differently.
  explicit GpuThermometer(const std::string& pci_bus_id, const char* library = "libnvidia-ml.so.1");
  ~GpuThermometer();
  GpuThermometer(const GpuThermometer&) = delete;
  GpuThermometer& operator=(const GpuThermometer&) = delete;

  /// Degrees Celsius; NaN without the library, the GPU or a sensor.
  double read() const;

 private:
  struct Nvml;
  std::unique_ptr<Nvml> nvml_;  // null where it cannot be had
};

/// Opens the sensors once and reads them as often as wanted. A reading asks the driver and waits for no work on the
/// GPU; it is meant to be taken about once a second.
class GpuSensors {
 public:
  /// The GPU with CUDA's number `index`; throws in a build without CUDA.
  explicit GpuSensors(int index);

  /// Leaves the current CUDA device of the thread as it is.
  GpuReading read() const;

 private:
  [[maybe_unused]] int index_;  // a build without CUDA has no use for it
  GpuThermometer thermometer_;
};

}  // namespace giga
