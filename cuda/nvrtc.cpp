// Loading NVRTC and compiling by it.
#include "cuda/nvrtc.hpp"

#include <dlfcn.h>

#include <filesystem>

#include "core/error.hpp"

namespace giga {
namespace {

/// The library beside the CUDA runtime, by its path; empty where this process has no runtime.
std::string beside_runtime(const std::string& library) {
  void* function = ::dlsym(RTLD_DEFAULT, "cudaRuntimeGetVersion");
  Dl_info info{};
  if (!function || !::dladdr(function, &info) || !info.dli_fname) return {};
  return std::filesystem::path(info.dli_fname).parent_path() / library;
}

void* load(const std::string& library) {
  constexpr int kHow = RTLD_NOW | RTLD_LOCAL;
  const std::string first = beside_runtime(library);
  void* loaded = first.empty() ? nullptr : ::dlopen(first.c_str(), kHow);
  return loaded ? loaded : ::dlopen(library.c_str(), kHow);
}

}  // namespace

template <class Function>
void Nvrtc::find(void* library, Function*& function, const char* name) {
  function = reinterpret_cast<Function*>(::dlsym(library, name));
  if (!function) missing_ = cat("no ", name, " in ", kLibrary);
}

Nvrtc::Nvrtc(const std::string& library) {
  void* loaded = load(library);
  if (!loaded) {
    missing_ = cat("no ", library, " here");
    return;
  }
  find(loaded, version_, "nvrtcVersion");
  find(loaded, create_, "nvrtcCreateProgram");
  find(loaded, compile_, "nvrtcCompileProgram");
  find(loaded, destroy_, "nvrtcDestroyProgram");
  find(loaded, code_size_, "nvrtcGetCUBINSize");
  find(loaded, code_, "nvrtcGetCUBIN");
  find(loaded, log_size_, "nvrtcGetProgramLogSize");
  find(loaded, log_, "nvrtcGetProgramLog");
  find(loaded, error_, "nvrtcGetErrorString");
}

std::string Nvrtc::version() const {
  int major = 0, minor = 0;
  version_(&major, &minor);
  return cat(major, ".", minor);
}

std::string Nvrtc::text_of(Handle handle, int (*size)(Handle, size_t*), int (*get)(Handle, char*)) const {
  size_t bytes = 0;
  if (size(handle, &bytes) != 0 || bytes == 0) return {};
  std::string text(bytes, '\0');
  if (get(handle, text.data()) != 0) return {};
  return text;
}

Nvrtc::Result Nvrtc::compile(const NvrtcProgram& program) const {
  std::vector<const char*> names, texts, options;
  for (const auto& [name, text] : program.headers) {
    names.push_back(name.c_str());
    texts.push_back(text.c_str());
  }
  for (const std::string& option : program.options) options.push_back(option.c_str());

  Handle handle = nullptr;
  int status =
      create_(&handle, program.source.c_str(), "kernel.cu", static_cast<int>(names.size()), texts.data(), names.data());
  if (status != 0) return {{}, error_(status)};
  status = compile_(handle, static_cast<int>(options.size()), options.data());
  Result result;
  result.log = text_of(handle, log_size_, log_);
  while (!result.log.empty() && (result.log.back() == '\0' || result.log.back() == '\n')) result.log.pop_back();
  if (status == 0) result.code = text_of(handle, code_size_, code_);
  if (result.code.empty() && result.log.empty()) result.log = error_(status);
  destroy_(&handle);
  return result;
}

}  // namespace giga
