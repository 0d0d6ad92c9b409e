// Making run folders, and finding the checkpoints in them.
#include "io/run_folder.hpp"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <system_error>
#include <vector>

#include "core/error.hpp"
#include "io/files.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char* kCheckpoints = "checkpoints";
constexpr int kMostRuns = 100'000;

[[noreturn]] void fail_to_create(const fs::path& path, const std::error_code& code) {
  throw InputError(cat("cannot create the folder ", path.string(), ": ", code.message()));
}

/// Makes the folder itself; false where it exists.
bool make_folder(const fs::path& path) {
  std::error_code code;
  if (path.has_parent_path()) fs::create_directories(path.parent_path(), code);
  if (code) fail_to_create(path.parent_path(), code);
  const bool made = fs::create_directory(path, code);
  if (code) fail_to_create(path, code);
  return made;
}

/// Number in "update_00000100.h5"; -1 for other names.
int64_t updates_of(const fs::path& file) {
  static constexpr std::string_view kPrefix = "update_", kEnding = ".h5";
  const std::string name = file.filename().string();
  if (name.size() <= kPrefix.size() + kEnding.size() || name.compare(0, kPrefix.size(), kPrefix) != 0 ||
      name.compare(name.size() - kEnding.size(), kEnding.size(), kEnding) != 0)
    return -1;
  const std::string digits = name.substr(kPrefix.size(), name.size() - kPrefix.size() - kEnding.size());
  const bool number = std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
  return number && digits.size() <= 18 ? std::stoll(digits) : -1;
}

/// The checkpoints in a folder, oldest first.
std::vector<fs::path> checkpoints_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (updates_of(entry.path()) >= 0) files.push_back(entry.path());
  std::sort(files.begin(), files.end(),
            [](const fs::path& a, const fs::path& b) { return updates_of(a) < updates_of(b); });
  return files;
}

}  // namespace

RunFolder RunFolder::create(const std::string& folder, const std::string& name) {
  fs::path path = folder;
  if (!folder.empty()) {
    std::error_code code;
    if (!make_folder(path) && !fs::is_empty(path, code))
      throw InputError(cat("the run folder ", folder, " is there already and not empty: a run is never overwritten"));
  } else {
    int number = 0;
    char text[16];
    do {
      if (++number > kMostRuns) throw InputError(cat("runs/", name, "-NNN: all numbers are taken"));
      std::snprintf(text, sizeof text, "-%03d", number);
      path = fs::path("runs") / (name + text);
    } while (!make_folder(path));
  }
  make_folder(path / kCheckpoints);
  return RunFolder(path);
}

fs::path RunFolder::checkpoint_file(int64_t updates) const {
  char name[48];
  std::snprintf(name, sizeof name, "update_%08lld.h5", static_cast<long long>(updates));
  return path_ / kCheckpoints / name;
}

void RunFolder::describe(const std::string& config_yaml, const std::string& scenario_yaml, const Json& info) const {
  write_file(config_file(), config_yaml);
  write_file(scenario_file(), scenario_yaml);
  write_file(info_file(), info.text() + "\n");
}

void RunFolder::save(const Checkpoint& checkpoint, int keep) const {
  const fs::path folder = path_ / kCheckpoints;
  remove_temporaries(folder);
  write_checkpoint(checkpoint_file(checkpoint.updates), checkpoint);
  const std::vector<fs::path> files = checkpoints_in(folder);
  for (size_t k = 0; k + static_cast<size_t>(std::max(keep, 1)) < files.size(); ++k) {
    std::error_code code;
    fs::remove(files[k], code);
  }
}

std::optional<fs::path> latest_checkpoint(const fs::path& run_folder) {
  std::vector<fs::path> files = checkpoints_in(run_folder / kCheckpoints);
  if (files.empty()) files = checkpoints_in(run_folder);  // the folder of checkpoints itself was meant
  if (files.empty()) return std::nullopt;
  return files.back();
}

fs::path resolve_checkpoint(const std::string& path) {
  std::error_code code;
  if (!fs::exists(path, code)) throw InputError(cat("there is no checkpoint or run folder ", path));
  if (!fs::is_directory(path, code)) return path;
  const std::optional<fs::path> newest = latest_checkpoint(path);
  if (!newest) throw InputError(cat("the folder ", path, " holds no checkpoint (checkpoints/update_NNNNNNNN.h5)"));
  return *newest;
}

std::string folder_name_of(const std::string& scenario) {
  const fs::path path = scenario;
  std::string name = path.extension() == ".yaml" ? path.stem().string() : path.filename().string();
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '.') c = '_';
  return name.empty() ? "run" : name;
}

}  // namespace giga
