// How much memory the machine, or the container that this process lives in, has left.
#pragma once

#include <cstdint>
#include <string>

namespace giga {

/// Bytes; `free` is what can be taken without swapping, caches of files counted as free.
struct MemorySpace {
  int64_t total = 0, free = 0;
};

/// From /proc/meminfo, bounded by the limits of the control groups (version 2) above this process. Throws Error where
/// the system does not tell. `root` is the folder in which proc/ and sys/ lie.
MemorySpace host_memory_space(const std::string& root = "");

}  // namespace giga
