// WorldRange: consecutive worlds of a simulator.
#pragma once

#include <cstdint>

namespace giga {

struct WorldRange {
  int64_t first = 0, count = 0;

  int64_t end() const { return first + count; }
  bool operator==(const WorldRange&) const = default;
};

}  // namespace giga
