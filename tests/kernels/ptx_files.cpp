#include "kernels/ptx_files.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>

#include "core/error.hpp"

namespace giga::test {
namespace {

constexpr const char* kFiles = GIGASTEP_PTX_FILES;  // paths, with a colon between them

std::string read_ptx(const std::string& name) {
  std::istringstream paths(kFiles);
  for (std::string path; std::getline(paths, path, ':');) {
    if (!std::filesystem::path(path).filename().string().starts_with(name + ".")) continue;
    std::ifstream file(path);
    GIGA_CHECK(file, "cannot read ", path);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  throw Error("no PTX of " + name);
}

}  // namespace

bool has_ptx() { return *kFiles != 0; }

const PtxModule& ptx_module(const std::string& name) {
  static std::map<std::string, PtxModule> modules;
  const auto found = modules.find(name);
  return found != modules.end() ? found->second : modules.emplace(name, PtxModule(read_ptx(name))).first->second;
}

}  // namespace giga::test
