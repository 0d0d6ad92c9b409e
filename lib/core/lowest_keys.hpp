// sort_lowest: the lowest of a constant number of keys in ascending order, by a sorting network: no branches, and on
// the GPU nothing but registers. Of Batcher's odd-even merge sort (1968) for each sixteen of them, and of his bitonic
// merge for what two sixteens have in common.
#pragma once

#include <cstdint>
#include <utility>

#include "core/host_device.hpp"

namespace giga {

/// The comparisons of a network over 16 keys: each puts the lower key first.
struct Comparisons {
  static constexpr int kMost = 63;
  int count = 0;
  int low[kMost] = {}, high[kMost] = {};
  constexpr void add(int a, int b) {
    low[count] = a;
    high[count++] = b;
  }
};
constexpr int kSortedKeys = 16;
constexpr Comparisons odd_even_merge_sort() {
  Comparisons all;
  for (int p = 1; p < kSortedKeys; p *= 2)
    for (int k = p; k >= 1; k /= 2)
      for (int j = k % p; j + k < kSortedKeys; j += 2 * k)
        for (int i = 0; i < k && i + j + k < kSortedKeys; ++i)
          if ((i + j) / (2 * p) == (i + j + k) / (2 * p)) all.add(i + j, i + j + k);
  return all;
}
constexpr Comparisons bitonic_merge() {
  Comparisons all;
  for (int k = kSortedKeys / 2; k >= 1; k /= 2)
    for (int i = 0; i < kSortedKeys; ++i)
      if ((i & k) == 0) all.add(i, i + k);
  return all;
}

GIGA_HD constexpr uint32_t lower_key(uint32_t a, uint32_t b) { return a < b ? a : b; }
GIGA_HD constexpr uint32_t higher_key(uint32_t a, uint32_t b) { return a < b ? b : a; }

/// Runs a network over keys[first] to keys[first + 15]; those at kCount and beyond count as larger than all.
template <Comparisons (*kNetwork)(), int kFirst, int kCount>
GIGA_HD void run_network(uint32_t (&keys)[kCount]) {
  constexpr Comparisons kAll = kNetwork();
  [&]<size_t... kAt>(std::index_sequence<kAt...>) {
    const auto compare = [&]<int kLow, int kHigh>() {
      if constexpr (kHigh < kCount) {
        const uint32_t a = keys[kLow], b = keys[kHigh];
        keys[kLow] = lower_key(a, b);
        keys[kHigh] = higher_key(a, b);
      }
    };
    (compare.template operator()<kFirst + kAll.low[kAt], kFirst + kAll.high[kAt]>(), ...);
  }
  (std::make_index_sequence<static_cast<size_t>(kAll.count)>{});
}

/// Puts the lowest 16 keys, or all of them, into keys[0], keys[1], ... in ascending order. What lies behind is left
/// over.
template <int kCount>
GIGA_HD void sort_lowest(uint32_t (&keys)[kCount]) {
  run_network<odd_even_merge_sort, 0>(keys);
  const auto merge = [&]<int kFirst>() {
    run_network<odd_even_merge_sort, kFirst>(keys);
    // The lower half of two ascending rows, one of them turned round, falls and rises once: it is bitonic.
    GIGA_UNROLL
    for (int k = 0; k < kSortedKeys; ++k)
      if (kFirst + kSortedKeys - 1 - k < kCount) keys[k] = lower_key(keys[k], keys[kFirst + kSortedKeys - 1 - k]);
    run_network<bitonic_merge, 0>(keys);
  };
  [&]<int... kChunk>(std::integer_sequence<int, kChunk...>) {
    (merge.template operator()<(kChunk + 1) * kSortedKeys>(), ...);
  }
  (std::make_integer_sequence<int, (kCount - 1) / kSortedKeys>{});
}

}  // namespace giga
