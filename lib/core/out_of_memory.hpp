// Whether an error is that memory ran out, by its message: LibTorch, the driver and we throw it as different types.
#pragma once

#include <string>

namespace giga {

inline bool tells_of_memory(const std::string& message) {
  for (const char* words : {"out of memory", "out of GPU memory", "can't allocate memory"})
    if (message.find(words) != std::string::npos) return true;
  return false;
}

}  // namespace giga
