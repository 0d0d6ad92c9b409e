// Groups of players whose strengths the games compare, and how the groups stand to each other.
#pragma once

#include <cstddef>
#include <vector>

#include "rating/bradley_terry.hpp"

namespace giga {

constexpr int kNSides = 2;

/// A group is a largest set of players in which a chain of "took points from" leads from each to each other: within it
/// the differences of strength are finite, between two groups they are infinite or unknown.
struct PlayerGroups {
  std::vector<int> group_of;           ///< [n] numbered from 0, a group that is above another before it
  size_t count = 0;                    ///< G
  std::vector<unsigned char> reaches;  ///< [G, G] whether a chain of "took points from" leads from row to column

  /// Whether group a is infinitely far above group b.
  bool above(int a, int b) const {
    const size_t i = static_cast<size_t>(a), j = static_cast<size_t>(b);
    return reaches[i * count + j] && !reaches[j * count + i];
  }
};

PlayerGroups find_groups(int n, const std::vector<PairScore>& scores);

}  // namespace giga
