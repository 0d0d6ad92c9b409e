// Reading the temperature of a GPU by NVML.
#include "cuda/sensors.hpp"

#include <dlfcn.h>

namespace giga {

/// The few functions of NVML that are needed, by NVIDIA's documentation of its C interface; a result of 0 is success.
struct GpuThermometer::Nvml {
  using Device = void*;
  struct Temperature {  // nvmlTemperature_v1_t
    unsigned version, sensor;
    int celsius;
  };
  static constexpr unsigned kTemperatureVersion = sizeof(Temperature) | 1u << 24;  // size and version 1
  static constexpr unsigned kGpuSensor = 0;                                        // NVML_TEMPERATURE_GPU

  void* library = nullptr;
  bool initialized = false;
  Device device = nullptr;
  int (*shutdown)() = nullptr;
  int (*temperature)(Device, Temperature*) = nullptr;             // drivers from 2025 on
  int (*old_temperature)(Device, unsigned, unsigned*) = nullptr;  // deprecated there

  Nvml() = default;
  Nvml(const Nvml&) = delete;
  Nvml& operator=(const Nvml&) = delete;
  ~Nvml() {
    if (initialized) shutdown();
    if (library) ::dlclose(library);
  }

  template <class Function>
  bool find(Function*& function, const char* name) {
    function = reinterpret_cast<Function*>(::dlsym(library, name));
    return function != nullptr;
  }
  /// False where anything is missing.
  bool open(const std::string& pci_bus_id, const char* name) {
    int (*init)() = nullptr;
    int (*by_pci_bus_id)(const char*, Device*) = nullptr;
    library = ::dlopen(name, RTLD_NOW | RTLD_LOCAL);
    if (!library || !find(init, "nvmlInit_v2") || !find(shutdown, "nvmlShutdown") ||
        !find(by_pci_bus_id, "nvmlDeviceGetHandleByPciBusId_v2"))
      return false;
    initialized = init() == 0;
    find(temperature, "nvmlDeviceGetTemperatureV");
    find(old_temperature, "nvmlDeviceGetTemperature");
    return initialized && by_pci_bus_id(pci_bus_id.c_str(), &device) == 0;
  }
};

GpuThermometer::GpuThermometer(const std::string& pci_bus_id, const char* library) {
  auto nvml = std::make_unique<Nvml>();
  if (nvml->open(pci_bus_id, library)) nvml_ = std::move(nvml);
}
GpuThermometer::~GpuThermometer() = default;

double GpuThermometer::read() const {
  if (nvml_) {
    Nvml::Temperature t{Nvml::kTemperatureVersion, Nvml::kGpuSensor, 0};
    if (nvml_->temperature && nvml_->temperature(nvml_->device, &t) == 0) return t.celsius;
    unsigned celsius = 0;
    if (nvml_->old_temperature && nvml_->old_temperature(nvml_->device, Nvml::kGpuSensor, &celsius) == 0)
      return celsius;
  }
  return GpuReading{}.temperature;
}

}  // namespace giga
