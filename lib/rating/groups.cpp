// Finding groups.
#include "rating/groups.hpp"

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
  PlayerGroups groups;
  groups.group_of.assign(size, -1);
  std::vector<size_t> first;  // player of each group
  for (size_t i = 0; i < size; ++i) {
    if (groups.group_of[i] >= 0) continue;
    for (size_t j = i; j < size; ++j)
      if (reach[i * size + j] && reach[j * size + i]) groups.group_of[j] = static_cast<int>(groups.count);
    first.push_back(i);
    ++groups.count;
  }
  for (const size_t a : first)
    for (const size_t b : first) groups.reaches.push_back(reach[a * size + b]);
  return groups;
}

}  // namespace giga
