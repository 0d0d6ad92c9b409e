#include "sim/saved_pairs.hpp"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "core/error.hpp"
#include "sim/grid.hpp"
#include "sim/vector_observation.hpp"

namespace giga {
namespace {

template <class T>
std::vector<T> saved(const std::string& name, const NamedArrays& in, int64_t count) {
  const NamedArray& array = find_array(in, name);
  if (array.bytes.size() != static_cast<size_t>(count) * sizeof(T))
    throw InputError(cat("array '", name, "' of the checkpoint has ", array.bytes.size(), " bytes, expected ",
                         static_cast<size_t>(count) * sizeof(T), ": it was written with other settings"));
  std::vector<T> values(static_cast<size_t>(count));
  std::memcpy(values.data(), array.bytes.data(), array.bytes.size());
  return values;
}

uint32_t bit_of(int agent) { return 1u << (agent % 32); }

}  // namespace

bool saved_with_lists(const std::string& prefix, const NamedArrays& in) {
  return std::any_of(in.begin(), in.end(), [&](const NamedArray& array) { return array.name == prefix + "fire"; });
}

void convert_pairs(const StateShape& shape, int n_worlds, const std::string& prefix, const NamedArrays& in,
                   const StateView& state, const PairLists& lists) {
  const int n = shape.n_agents, words = words_for(n);
  const int64_t agents = int64_t{n_worlds} * n;
  if (!shape.lists()) {
    const NamedArray &fire = find_array(in, prefix + "fire"), &neighbors = find_array(in, prefix + "neighbors");
    const auto of_agent = [&](const NamedArray& array) {
      return static_cast<int64_t>(array.bytes.size() / sizeof(uint32_t)) / agents;
    };
    const int64_t shooters = of_agent(fire), rows = of_agent(neighbors);
    const auto entries = saved<uint32_t>(fire.name, in, agents * shooters);
    const auto row = saved<uint32_t>(neighbors.name, in, agents * rows);
    for (int64_t i = 0; i < agents; ++i) {
      for (int64_t k = i * shooters; k < (i + 1) * shooters; ++k)
        if (const uint32_t entry = entries[static_cast<size_t>(k)]; entry != 0 && shooter_of(entry) < n)
          state.tracked[i * n + shooter_of(entry)] = static_cast<uint8_t>(count_of(entry));
      for (int64_t k = i * rows; k < (i + 1) * rows; ++k)
        if (const uint32_t agent = row[static_cast<size_t>(k)]; agent < static_cast<uint32_t>(n))
          state.seen[i * words + agent / 32] |= bit_of(static_cast<int>(agent));
    }
    return;
  }
  const auto tracked = saved<uint8_t>(prefix + "tracked", in, agents * n);
  const auto seen = saved<uint32_t>(prefix + "seen", in, agents * words);
  std::vector<std::pair<float, int>> order;
  for (int64_t i = 0; i < agents; ++i) {
    const int64_t first = i / n * n;  // agent of the world
    const auto e = static_cast<int>(i - first);
    int shooting = 0;
    order.clear();
    for (int a = 0; a < n; ++a) {
      const int count = tracked[static_cast<size_t>(i * n + a)];
      if (count > 0 && shooting == shape.shooters)
        throw InputError(cat("in the checkpoint more than ", shape.shooters, " opponents fire at an agent, as many as ",
                             "are counted by place; go on with train.pairs: tables"));
      if (count > 0) lists.fire[i * shape.shooters + shooting++] = fire_entry(a, count);
      if (a == e || !(seen[static_cast<size_t>(i * words + a / 32)] & bit_of(a))) continue;
      order.emplace_back(order_distance(state.x[first + a] - state.x[i], state.y[first + a] - state.y[i]), a);
    }
    std::sort(order.begin(), order.end());
    uint32_t* const row = lists.neighbors + i * shape.rows;
    std::fill_n(row, shape.rows, kNoAgent);
    if (seen[static_cast<size_t>(i * words + e / 32)] & bit_of(e)) row[0] = static_cast<uint32_t>(e);
    const auto shown = std::min(order.size(), static_cast<size_t>(shape.rows - 1));
    for (size_t k = 0; k < shown; ++k) row[k + 1] = static_cast<uint32_t>(order[k].second);
  }
}

}  // namespace giga
