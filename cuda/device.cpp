// Choosing a device by name, and what belongs to it.
#include "core/error.hpp"
#include "cuda/runtime.hpp"

namespace giga {

Device parse_device(const std::string& text) {
  if (text == "cpu") return {};
  const int count = cuda_device_count();
  if (text == "auto") return count > 0 ? Device{Device::Kind::cuda, 0} : Device{};
  int index = -1;
  if (text == "cuda") {
    index = 0;
  } else if (text.rfind("cuda:", 0) == 0 && text.size() > 5 && text.size() < 9 &&
             text.find_first_not_of("0123456789", 5) == std::string::npos) {
    index = std::stoi(text.substr(5));
  }
  if (index < 0) throw InputError(cat("device '", text, "' is unknown; allowed: auto, cpu, cuda, cuda:<number>"));
  if (index >= count)
    throw InputError(cat("device '", text, "' is not there: ", count, count == 1 ? " GPU" : " GPUs",
                         " found; use --device cpu or auto"));
  return {Device::Kind::cuda, index};
}

std::unique_ptr<Simulator> make_simulator(SimSpec spec, const SimOptions& options, Device device, void* stream) {
  if (finds_by_place(spec, options)) {
    if (device.is_cuda()) return make_cuda_grid_simulator(std::move(spec), options, device.index, stream);
    return make_grid_simulator(std::move(spec), options);
  }
  if (device.is_cuda()) return make_cuda_simulator(std::move(spec), options, device.index, stream);
  return make_cpu_simulator(std::move(spec), options);
}

}  // namespace giga
