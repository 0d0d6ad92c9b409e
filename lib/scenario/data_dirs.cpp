// Looks for the data folders: environment, installation, source tree.
#include "scenario/data_dirs.hpp"

#include <cstdlib>
#include <set>
#include <system_error>

#include "core/error.hpp"

namespace giga {
namespace fs = std::filesystem;

namespace {

bool holds_data(const fs::path& folder) {
  std::error_code code;
  return fs::is_directory(folder / "scenarios", code);
}

}  // namespace

DataDirs data_dirs() {
  DataDirs dirs;
  const auto add_if_there = [&](const fs::path& folder) {
    if (holds_data(folder)) dirs.push_back(folder);
  };
  if (const char* wanted = std::getenv("GIGASTEP_DATA_DIR"); wanted && *wanted) {
    if (!holds_data(wanted))
      throw InputError(cat("GIGASTEP_DATA_DIR=", wanted, ": there is no folder 'scenarios' in it"));
    dirs.emplace_back(wanted);
  }
  std::error_code code;
  const fs::path executable = fs::read_symlink("/proc/self/exe", code);
  if (!code) add_if_there(executable.parent_path().parent_path() / "share" / "gigastep");
#if defined(GIGASTEP_SOURCE_DIR)
  add_if_there(GIGASTEP_SOURCE_DIR);
#endif
  return dirs;
}

std::optional<fs::path> find_data_file(const DataDirs& dirs, const fs::path& relative) {
  std::error_code code;
  for (const fs::path& dir : dirs)
    if (fs::is_regular_file(dir / relative, code)) return dir / relative;
  return std::nullopt;
}

std::vector<std::string> data_names(const DataDirs& dirs, const std::string& folder) {
  std::set<std::string> names;
  for (const fs::path& dir : dirs) {
    std::error_code code;
    for (const fs::directory_entry& entry : fs::directory_iterator(dir / folder, code))
      if (entry.path().extension() == ".yaml") names.insert(entry.path().stem().string());
  }
  return {names.begin(), names.end()};
}

}  // namespace giga
