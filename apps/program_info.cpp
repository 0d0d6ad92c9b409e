// Versions, hardware and command line of this process.
#include "apps/program_info.hpp"

#include <torch/version.h>

#include <filesystem>
#include <fstream>
#include <system_error>
#include <vector>

#include "cuda/runtime.hpp"
#include "io/host_info.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> arguments() {
  std::ifstream in("/proc/self/cmdline", std::ios::binary);
  std::vector<std::string> words;
  for (std::string word; std::getline(in, word, '\0');) words.push_back(word);
  return words;
}

/// 13000 = "13.0", as the CUDA runtime numbers its versions.
std::string cuda_version_text(int version) {
  return version == 0 ? "none" : std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

}  // namespace

std::string program_version() {
#if defined(GIGASTEP_GIT)
  return GIGASTEP_VERSION " (" GIGASTEP_GIT ")";
#else
  return GIGASTEP_VERSION;
#endif
}

std::string program_command() {
  const std::vector<std::string> words = arguments();
  if (words.empty() || words.front().find('/') == std::string::npos) return "gigastep";
  std::error_code code;
  const fs::path relative = fs::path(words.front()).lexically_proximate(fs::current_path(code));
  const bool below = !relative.empty() && *relative.begin() != "..";
  return shell_word(below && relative.is_relative() ? "./" + relative.string() : words.front());
}

std::string shell_word(const std::string& text) {
  static constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./:=,+@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
}

Json version_info() {
  Json info = Json::object();
  info.set("gigastep", program_version()).set("torch", TORCH_VERSION).set("compiler", __VERSION__);
  info.set("built_with_cuda", static_cast<bool>(GIGASTEP_HAS_CUDA));
  return info;
}

Json hardware_info(Device device) {
  const HostInfo host = host_info();
  Json info = Json::object();
  info.set("device", device.name()).set("cpu", host.cpu).set("cores", host.cores);
  info.set("memory_bytes", host.memory_bytes).set("os", host.os).set("kernel", host.kernel);
  if (device.is_cuda()) {
    const GpuInfo gpu = cuda_device_info(device.index);
    Json card = Json::object();
    card.set("name", gpu.name).set("memory_bytes", gpu.memory_total);
    card.set("compute_capability", gpu.compute_capability);
    card.set("driver_cuda", cuda_version_text(gpu.driver_version));
    card.set("runtime_cuda", cuda_version_text(gpu.runtime_version));
    info.set("gpu", std::move(card));
  }
  return info;
}

Json command_line() { return Json::array(arguments()); }

}  // namespace giga
