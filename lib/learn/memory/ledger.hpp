// MemoryLedger: what is allocated at a time, by use, while the steps of some work are gone through; keeps its peak.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace giga {

constexpr int64_t kFloat = 4;  ///< bytes of a number in fp32

/// What the memory of an update that comes and goes is for.
enum class MemoryUse : uint8_t { permutation, minibatch, actor, critic, values, temporary };
constexpr size_t kNMemoryUses = 6;
constexpr std::array<const char*, kNMemoryUses> kMemoryUseNames = {
    "permutation of the states", "gathered minibatch",   "actor activations",
    "critic activations",        "values in the making", "temporaries",
};

using MemoryByUse = std::array<int64_t, kNMemoryUses>;
inline int64_t sum(const MemoryByUse& bytes) {
  int64_t total = 0;
  for (const int64_t b : bytes) total += b;
  return total;
}

class MemoryLedger {
 public:
  void take(MemoryUse use, int64_t bytes) {
    live_[static_cast<size_t>(use)] += bytes;
    if (sum(live_) > sum(peak_)) peak_ = live_;
  }
  void give(MemoryUse use, int64_t bytes) { live_[static_cast<size_t>(use)] -= bytes; }
  /// Memory that is given back at once.
  void touch(int64_t bytes) {
    take(MemoryUse::temporary, bytes);
    give(MemoryUse::temporary, bytes);
  }

  int64_t live() const { return sum(live_); }
  const MemoryByUse& peak() const { return peak_; }

 private:
  MemoryByUse live_{}, peak_{};
};

}  // namespace giga
