// Reading a GPU's memory by the CUDA runtime and its temperature by NVML.
#include "cuda/sensors.hpp"

#include <dlfcn.h>

#include "core/error.hpp"
#if GIGASTEP_HAS_CUDA
#include "cuda/check.cuh"
#endif

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

#if GIGASTEP_HAS_CUDA

namespace {

std::string pci_bus_id(int index) {
  char text[32];
  GIGA_CUDA(cudaDeviceGetPCIBusId(text, sizeof text, index));
  return text;
}

}  // namespace

GpuSensors::GpuSensors(int index) : index_(index), thermometer_(pci_bus_id(index)) {}

GpuReading GpuSensors::read() const {
  int before = 0;
  GIGA_CUDA(cudaGetDevice(&before));
  GIGA_CUDA(cudaSetDevice(index_));
  size_t free = 0, total = 0;
  const cudaError_t status = cudaMemGetInfo(&free, &total);
  GIGA_CUDA(cudaSetDevice(before));
  GIGA_CUDA(status);
  return {static_cast<int64_t>(total - free), static_cast<int64_t>(total), thermometer_.read()};
}

#else

GpuSensors::GpuSensors(int index) : index_(index), thermometer_("") {
  throw InputError("this build has no CUDA; use --device cpu");
}
GpuReading GpuSensors::read() const { return {}; }

#endif

}  // namespace giga
