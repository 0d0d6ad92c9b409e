// Finding groups.
#include "rating/groups.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga {
namespace {

/// Whether a chain of "took points from" leads from row to column: the closure by Warshall's algorithm.
std::vector<unsigned char> chains(size_t n, const std::vector<PairScore>& scores) {
  std::vector<unsigned char> reach(n * n, 0);
  for (size_t i = 0; i < n; ++i) reach[i * n + i] = 1;
  for (const PairScore& p : scores) {
    const size_t a = static_cast<size_t>(p.a), b = static_cast<size_t>(p.b);
    if (p.score_a > 0) reach[a * n + b] = 1;
    if (p.score_b > 0) reach[b * n + a] = 1;
  }
  for (size_t via = 0; via < n; ++via)
    for (size_t from = 0; from < n; ++from) {
      if (!reach[from * n + via]) continue;
      for (size_t to = 0; to < n; ++to) reach[from * n + to] |= reach[via * n + to];
    }
  return reach;
}

}  // namespace

PlayerGroups find_groups(int n, const std::vector<PairScore>& scores) {
  GIGA_CHECK(n >= 0, n, " players");
  const size_t size = static_cast<size_t>(n);
  const std::vector<unsigned char> reach = chains(size, scores);
  const auto together = [&](size_t i, size_t j) { return reach[i * size + j] && reach[j * size + i]; };
  std::vector<size_t> first;  // player of each group
  for (size_t i = 0; i < size; ++i)
    if (std::none_of(first.begin(), first.end(), [&](size_t j) { return together(i, j); })) first.push_back(i);
  // Who is above another reaches all that it reaches, and itself besides.
  const auto reached = [&](size_t i) { return std::count(&reach[i * size], &reach[i * size] + size, 1); };
  std::stable_sort(first.begin(), first.end(), [&](size_t i, size_t j) { return reached(i) > reached(j); });
  PlayerGroups groups;
  groups.count = first.size();
  groups.group_of.resize(size);
  for (size_t i = 0; i < size; ++i)
    groups.group_of[i] = static_cast<int>(
        std::find_if(first.begin(), first.end(), [&](size_t j) { return together(i, j); }) - first.begin());
  for (const size_t a : first)
    for (const size_t b : first) groups.reaches.push_back(reach[a * size + b]);
  return groups;
}

}  // namespace giga
