#include "ranked_run.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "core/error.hpp"

namespace giga::test {

NamedArrays arrays_of(const Workplace& here, const std::string& run) {
  return find_checkpoint((here.path() / run).string()).checkpoint.arrays;
}

double difference(const NamedArrays& a, const NamedArrays& b) {
  if (a.size() != b.size()) return INFINITY;
  double greatest = 0;
  for (size_t k = 0; k < a.size(); ++k) {
    if (a[k].name != b[k].name || a[k].shape != b[k].shape) return INFINITY;
    if (a[k].type != ArrayType::f32) {
      if (a[k].bytes != b[k].bytes) return INFINITY;
      continue;
    }
    const std::vector<float> x = array_values<float>(a[k]), y = array_values<float>(b[k]);
    for (size_t i = 0; i < x.size(); ++i)
      greatest = std::max(greatest, static_cast<double>(std::fabs(x[i] - y[i]) / std::max(1.0f, std::fabs(x[i]))));
  }
  return greatest;
}

Environment rank_of_two(int rank, int port) {
  return {{"RANK", std::to_string(rank)},
          {"LOCAL_RANK", std::to_string(rank)},
          {"WORLD_SIZE", "2"},
          {"MASTER_ADDR", "127.0.0.1"},
          {"MASTER_PORT", std::to_string(port)}};
}

RankedRun::RankedRun() {
  here_.write("es.yaml", kRankedEvolution);
  here_.write("mappo.yaml", kRankedMappo);
}

std::vector<std::string> RankedRun::train(const std::string& run, int ranks, const std::vector<std::string>& more) {
  std::vector<std::string> words = {"train", "es.yaml", "--run-dir", run};
  if (ranks > 1) words.insert(words.end(), {"--ranks", std::to_string(ranks)});
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

std::vector<int> RankedRun::ranks_of(int parent) {
  std::vector<int> pids;
  std::ifstream children(cat("/proc/", parent, "/task/", parent, "/children"));
  for (int pid = 0; children >> pid;) pids.push_back(pid);
  return pids;
}

}  // namespace giga::test
