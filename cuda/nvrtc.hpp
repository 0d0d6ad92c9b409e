// Nvrtc: NVIDIA's compiler of CUDA code at run time, which is loaded where it is found.
#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace giga {

struct NvrtcProgram {
  std::string source;
  std::vector<std::pair<std::string, std::string>> headers;  ///< names as they are included, and texts
  std::vector<std::string> options;
};

/// The handful of functions of NVRTC that are needed, by NVIDIA's documentation of its C interface.
class Nvrtc {
 public:
  static constexpr const char* kLibrary = "libnvrtc.so.13";

  /// Loads the library: that beside the CUDA runtime of this process, which is LibTorch's, else the one that the loader
  /// finds. It stays loaded, because LibTorch may use it too.
  explicit Nvrtc(const std::string& library = kLibrary);

  /// Why there is no compiler; empty: there is one.
  const std::string& missing() const { return missing_; }
  /// "13.0"
  std::string version() const;

  struct Result {
    std::string code;  ///< for a GPU; empty where compiling failed
    std::string log;
  };
  /// Compiles a program for the architecture in its options, sm_<number>.
  Result compile(const NvrtcProgram& program) const;

 private:
  using Handle = void*;
  template <class Function>
  void find(void* library, Function*& function, const char* name);
  std::string text_of(Handle handle, int (*size)(Handle, size_t*), int (*get)(Handle, char*)) const;

  std::string missing_;
  int (*version_)(int*, int*) = nullptr;
  int (*create_)(Handle*, const char*, const char*, int, const char* const*, const char* const*) = nullptr;
  int (*compile_)(Handle, int, const char* const*) = nullptr;
  int (*destroy_)(Handle*) = nullptr;
  int (*code_size_)(Handle, size_t*) = nullptr;
  int (*code_)(Handle, char*) = nullptr;
  int (*log_size_)(Handle, size_t*) = nullptr;
  int (*log_)(Handle, char*) = nullptr;
  const char* (*error_)(int) = nullptr;
};

}  // namespace giga
