// Versions, hardware and command line of this process.
#include "apps/program_info.hpp"

#include <elf.h>
#include <link.h>
#include <torch/version.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
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

/// The note that the linker left in a loaded file: a hash of all of it, in hexadecimal; empty where there is none.
std::string build_note(const dl_phdr_info& file, const ElfW(Phdr) & segment) {
  const auto* at = reinterpret_cast<const unsigned char*>(file.dlpi_addr + segment.p_vaddr);
  const auto* const end = at + segment.p_memsz;
  const auto padded = [](size_t size) { return (size + 3) & ~size_t{3}; };
  while (at + sizeof(ElfW(Nhdr)) <= end) {
    const auto& note = *reinterpret_cast<const ElfW(Nhdr)*>(at);
    const unsigned char* const value = at + sizeof note + padded(note.n_namesz);
    if (note.n_type == NT_GNU_BUILD_ID) {
      std::string text;
      for (size_t k = 0; k < note.n_descsz; ++k) {
        text += "0123456789abcdef"[value[k] >> 4];
        text += "0123456789abcdef"[value[k] & 15];
      }
      return text;
    }
    at = value + padded(note.n_descsz);
  }
  return "";
}

/// That of the program itself, which the loader lists first.
std::string build_id() {
  std::string id;
  dl_iterate_phdr(
      [](dl_phdr_info* file, size_t, void* result) {
        auto& text = *static_cast<std::string*>(result);
        for (int k = 0; k < file->dlpi_phnum && text.empty(); ++k)
          if (file->dlpi_phdr[k].p_type == PT_NOTE) text = build_note(*file, file->dlpi_phdr[k]);
        return 1;
      },
      &id);
  return id;
}

/// Whether the program's sources were those of its commit; none where the build could not tell.
std::optional<bool> clean_tree() {
  const std::string_view commit = program_commit();
  if (commit == "unknown") return std::nullopt;
  return !commit.ends_with("-dirty");
}

/// 13000 = "13.0", as the CUDA runtime numbers its versions.
std::string cuda_version_text(int version) {
  return version == 0 ? "none" : std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

}  // namespace

std::string program_version() {
  const std::string id = build_id();
  const std::optional<bool> clean = clean_tree();
  const std::string tree = !clean ? "" : *clean ? ", clean tree" : ", changed tree";
  const std::string version = std::string(GIGASTEP_VERSION " (commit ") + program_commit() + tree;
  return id.empty() ? version + ")" : version + ", build " + id.substr(0, 12) + ")";
}

std::string program_command() {
  const std::vector<std::string> words = arguments();
  if (words.empty() || words.front().find('/') == std::string::npos) return "gigastep";
  std::error_code code;
  const fs::path relative =
      fs::absolute(words.front(), code).lexically_normal().lexically_proximate(fs::current_path(code));
  const bool below = !relative.empty() && *relative.begin() != "..";
  return shell_word(below && relative.is_relative() ? "./" + relative.string() : words.front());
}

Json version_info() {
  return {{"gigastep", program_version()},
          {"commit", program_commit()},
          {"clean_tree", clean_tree() ? Json(*clean_tree()) : Json()},
          {"torch", TORCH_VERSION},
          {"compiler", __VERSION__},
          {"built_with_cuda", built_with_cuda()}};
}

Json hardware_info(Device device) {
  const HostInfo host = host_info();
  Json info{{"device", device.name()},           {"cpu", host.cpu}, {"cores", host.cores},
            {"memory_bytes", host.memory_bytes}, {"os", host.os},   {"kernel", host.kernel}};
  if (device.is_cuda()) {
    const GpuInfo gpu = cuda_device_info(device.index);
    info["gpu"] = {{"name", gpu.name},
                   {"memory_bytes", gpu.memory_total},
                   {"compute_capability", gpu.compute_capability},
                   {"driver_cuda", cuda_version_text(gpu.driver_version)},
                   {"runtime_cuda", cuda_version_text(gpu.runtime_version)}};
  }
  return info;
}

Json command_line() { return arguments(); }

}  // namespace giga
