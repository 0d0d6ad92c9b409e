// RankedRun: a place for one training by several processes, and how far what they make is apart.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "io/run_folder.hpp"
#include "runs.hpp"

namespace giga::test {

/// What ranks train: es.yaml and mappo.yaml of a RankedRun.
inline constexpr const char* kRankedEvolution = R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {algorithm: openai_es, total_agent_steps: 8000, n_threads: 1}
population: {population_size: 8, episodes_per_member: 2, max_steps: 60, actor: {hidden: [8]}}
opponents: {pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp}
eval: {episodes: 8, every_updates: 2, record: 0}
checkpoint: {every_updates: 1}
)";

/// An update: 16 worlds x 8 steps x 4 agents = 512 agent-steps; a shard: 2 worlds x 8 steps = 16 states, 4 in a
/// minibatch.
inline constexpr const char* kRankedMappo = R"(scenario: identical_2_vs_2_fobs_vec_void_disc
device: cpu
train: {algorithm: mappo, n_worlds: 16, total_agent_steps: 1536, n_threads: 1, desynchronize: true}
mappo: {horizon: 8, n_minibatches: 4, n_epochs: 2, shards: 8, actor: {hidden: [8, 8]}, critic: {hidden: [8, 8]}}
eval: {episodes: 8, every_updates: 0, record: 0}
checkpoint: {every_updates: 1}
)";

/// The state in the newest checkpoint of a run, or in a file.
NamedArrays arrays_of(const Workplace& here, const std::string& run);

/// Where two states differ by more than rounding: the greatest difference of fp32 numbers, relative to 1 or the number;
/// infinite where shapes or integers differ.
double difference(const NamedArrays& a, const NamedArrays& b);

/// The environment of a rank of two, as torchrun makes it; rank 0 serves the store.
Environment rank_of_two(int rank, int port);

class RankedRun : public ::testing::Test {
 protected:
  RankedRun();
  /// The words of a command.
  static std::vector<std::string> train(const std::string& run, int ranks, const std::vector<std::string>& more = {});
  /// Processes that were started by this test and are ranks: their ids by rank.
  static std::vector<int> ranks_of(int parent);
  Workplace here_;
};

}  // namespace giga::test
