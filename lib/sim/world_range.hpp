// WorldRange: consecutive worlds of a simulator; ShardRange: the same range in each of several parts of them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace giga {

struct WorldRange {
  int64_t first = 0, count = 0;

  int64_t end() const { return first + count; }
  bool operator==(const WorldRange&) const = default;
};

/// Part k of n parts of a range that differ by one world at most.
inline WorldRange part_of(const WorldRange& range, int64_t k, int64_t n) {
  const int64_t from = range.count * k / n, to = range.count * (k + 1) / n;
  return {range.first + from, to - from};
}

/// The same range of each shard; shards are parts of equally many worlds, one behind the other.
struct ShardRange {
  WorldRange in_shard;
  int64_t shard_size = 0, n_shards = 1;

  int64_t count() const { return in_shard.count * n_shards; }
  bool everywhere() const { return in_shard.count == shard_size; }
  /// The worlds of it in shard `k`.
  WorldRange of(int64_t k) const { return {k * shard_size + in_shard.first, in_shard.count}; }
  /// All of them, in ranges of at most `most` worlds.
  std::vector<WorldRange> pieces(int64_t most) const {
    std::vector<WorldRange> all;
    const auto add = [&](const WorldRange& range) {
      for (int64_t from = range.first; from < range.end(); from += most)
        all.push_back({from, std::min(most, range.end() - from)});
    };
    if (everywhere()) add({0, count()});
    for (int64_t k = 0; k < n_shards && !everywhere(); ++k) add(of(k));
    return all;
  }
  bool operator==(const ShardRange&) const = default;
};

}  // namespace giga
