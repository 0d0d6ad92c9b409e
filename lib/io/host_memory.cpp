// The machine's own figures, then every limit on the way up from this process's control group.
#include "io/host_memory.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>

#include "core/error.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

/// The number behind the first word `key` of a file of "key number" lines.
std::optional<int64_t> number_behind(const fs::path& file, const std::string& key) {
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);)
    if (line.starts_with(key + " ")) return std::stoll(line.substr(key.size()));
  return std::nullopt;
}

/// The number that a file consists of; none where there is no file, or where it says "max".
std::optional<int64_t> number_in(const fs::path& file) {
  std::ifstream in(file);
  int64_t number = 0;
  if (in >> number) return number;
  return std::nullopt;
}

/// This process's path below the mount of the control groups, version 2: the line "0::/path".
std::string control_group(const std::string& root) {
  std::ifstream in(root + "/proc/self/cgroup");
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("0::/")) return line.substr(4);
  return "";
}

void apply_limit(const fs::path& group, MemorySpace& space) {
  const std::optional<int64_t> limit = number_in(group / "memory.max"), used = number_in(group / "memory.current");
  if (!limit || !used) return;
  const int64_t caches = number_behind(group / "memory.stat", "inactive_file").value_or(0) +
                         number_behind(group / "memory.stat", "active_file").value_or(0);
  space.total = std::min(space.total, *limit);
  space.free = std::min(space.free, std::max<int64_t>(0, *limit - *used + caches));
}

}  // namespace

MemorySpace host_memory_space(const std::string& root) {
  const fs::path info = root + "/proc/meminfo";
  const std::optional<int64_t> total = number_behind(info, "MemTotal:"), free = number_behind(info, "MemAvailable:");
  if (!total || !free) throw Error(cat(info.string(), " does not tell MemTotal and MemAvailable"));
  MemorySpace space{*total * 1024, *free * 1024};  // there in kB

  const fs::path mount = root + "/sys/fs/cgroup";
  for (fs::path group = mount / control_group(root);; group = group.parent_path()) {
    apply_limit(group, space);
    if (group == mount || group.native().size() <= mount.native().size()) break;
  }
  return space;
}

}  // namespace giga
