// One training by several processes: the same result as by one, and what cannot be divided is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/error.hpp"
#include "io/files.hpp"
#include "ranked_run.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Of what updates of mappo report, which sums of another order change.
constexpr double kMetricsTolerance = 1e-3;

/// How far the figures of two runs are apart: the greatest difference, relative to 1 or the number; infinite where
/// columns, rows or what is known differ. Not of times, nor of evaluations, which are few games: rounding may end one
/// another way.
double metrics_apart(const Workplace& here, const std::string& a, const std::string& b) {
  const CsvTable x = parse_csv(here.read(a + "/metrics.csv")), y = parse_csv(here.read(b + "/metrics.csv"));
  if (x.columns != y.columns || x.rows.size() != y.rows.size()) return INFINITY;
  double greatest = 0;
  for (size_t column = 0; column < x.columns.size(); ++column) {
    const std::string& name = x.columns[column];
    if (name.ends_with("seconds") || name.ends_with("per_second") || name.find("_vs_") != std::string::npos) continue;
    for (size_t row = 0; row < x.rows.size(); ++row) {
      const std::string &one = x.rows[row][column], &other = y.rows[row][column];
      if (one == other) continue;  // or both are not known
      const double u = std::atof(one.c_str()), v = std::atof(other.c_str());
      const double apart = std::fabs(u - v) / std::max(1.0, std::fabs(u));
      if (!std::isfinite(apart) || one.empty() || other.empty()) return INFINITY;
      greatest = std::max(greatest, apart);
    }
  }
  return greatest;
}

TEST_F(RankedRun, EqualsTheRunOfOneProcessBitForBit) {
  ASSERT_EQ(here_.run(train("one", 1)).code, 0);
  for (const int ranks : {2, 8}) {
    const std::string run = cat("by_", ranks);
    const Outcome outcome = here_.run(train(run, ranks));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {cat("shared by ", ranks, " ranks")}));
    EXPECT_EQ(state_hash(here_, run), state_hash(here_, "one"));
    EXPECT_EQ(metrics_difference(timeless_metrics(here_, run), timeless_metrics(here_, "one")), "");
  }
}

// Each rank adds up for its own parameters, whose noise may be made of numbers of others, and what its members weigh
// crosses.
TEST_F(RankedRun, WithNoiseOfLowRankEqualsTheRunOfOneProcessBitForBit) {
  for (const int ranks : {1, 2}) {
    std::vector<std::string> words = train(cat("by_", ranks), ranks);
    words.insert(words.end(), {"--set", "population.noise=low_rank", "--set", "population.shaping.weight_decay=0.1"});
    const Outcome outcome = here_.run(words);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
  }
  EXPECT_EQ(state_hash(here_, "by_2"), state_hash(here_, "by_1"));
  EXPECT_EQ(metrics_difference(timeless_metrics(here_, "by_2"), timeless_metrics(here_, "by_1")), "");
}

// Sums over ranks are added in another order than by one process: rounding, which three updates carry on. What is
// learned from is the same: worlds, draws, minibatches, moments.
TEST_F(RankedRun, OfMappoEqualsTheRunOfOneProcessToRounding) {
  const std::vector<std::vector<std::string>> settings = {
      {},
      {"--set", "mappo.fused=false", "--set", "mappo.obs_norm=true", "--set", "mappo.advantage_norm=batch"},
      {"--set", "mappo.actor.memory=gru", "--set", "mappo.critic.memory=gru", "--set", "mappo.shards=4"},
      {"--set", "mappo.critic.shared_encoder=true", "--set", "mappo.obs_norm=true"},
      {"--set", "mappo.one_policy=true", "--set", "mappo.obs_norm=true"},
      {"--set", "mappo.critic.kind=state", "--set", "train.opponent=circle", "--set", "mappo.target_kl=0.001"},
      {"--set", "train.opponent=./team.yaml"}};
  here_.write("team.yaml", "policies: [circle, random]\n");  // a world each in each shard
  const size_t n_settings = tests_run_in_full() ? settings.size() : 1;
  for (size_t k = 0; k < n_settings; ++k) {
    SCOPED_TRACE(k);
    const auto run = [&](const std::string& name, int ranks, const std::vector<std::string>& more = {}) {
      std::vector<std::string> words = train(name, ranks, settings[k]);
      words[1] = "mappo.yaml";
      words.insert(words.end(), more.begin(), more.end());
      const Outcome outcome = here_.run(words);
      EXPECT_EQ(outcome.code, more.empty() ? 0 : 124) << outcome.err;
      return name;
    };
    const NamedArrays one = arrays_of(here_, run(cat("one", k), 1));
    const NamedArrays two = arrays_of(here_, run(cat("two", k), 2));
    EXPECT_LT(difference(one, two), 1e-4);
    EXPECT_LT(metrics_apart(here_, cat("one", k), cat("two", k)), kMetricsTolerance);
    // The same ranks give the same bits.
    EXPECT_EQ(state_hash(here_, run(cat("again", k), 2)), state_hash(here_, cat("two", k)));
    EXPECT_EQ(metrics_difference(timeless_metrics(here_, cat("again", k)), timeless_metrics(here_, cat("two", k))), "");
    if (k == 0) {
      EXPECT_LT(difference(one, arrays_of(here_, run("eight", 8))), 1e-4);
      EXPECT_LT(metrics_apart(here_, "one0", "eight"), kMetricsTolerance);
    }
    // Begun by two and ended by one.
    const std::string begun = run(cat("begun", k), 2, {"--set", "train.stop_at_agent_steps=512"});
    const Outcome resumed = here_.run({"resume", begun, "--set", "train.stop_at_agent_steps=none"});
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_LT(difference(one, arrays_of(here_, begun)), 1e-4);
    EXPECT_EQ(metrics_rows(here_, begun), 3u);
  }
}

// Each shard has worlds against scripts and against the pool; their games count for the pools of all ranks, which
// meet the same opponents. Its four shards of 8 worlds have for each team one world against circle and two groups of
// one world against the pool.
TEST_F(RankedRun, OfMappoWithFurtherOpponentsEqualsTheRunOfOneProcessToRounding) {
  here_.write("pool.yaml", cat("opponents: {pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp, "
                               "scripted: [circle], scripted_share: 0.25}\n",
                               kRankedMappo));
  const std::vector<std::vector<std::string>> settings = {
      {},
      {"--set", "mappo.actor.memory=gru", "--set", "mappo.critic.memory=gru"},
      {"--set", "mappo.fused=false", "--set", "opponents.pool_promotion=evidence"}};
  const size_t n_settings = tests_run_in_full() ? settings.size() : 1;
  for (size_t k = 0; k < n_settings; ++k) {
    SCOPED_TRACE(k);
    const auto run = [&](const std::string& name, int ranks, const std::vector<std::string>& more = {}) {
      std::vector<std::string> words = train(name, ranks, settings[k]);
      words[1] = "pool.yaml";
      for (const char* set :
           {"train.n_worlds=32", "mappo.horizon=32", "mappo.shards=4", "train.total_agent_steps=16384"})
        words.insert(words.end(), {"--set", set});
      words.insert(words.end(), more.begin(), more.end());
      const Outcome outcome = here_.run(words);
      EXPECT_EQ(outcome.code, more.empty() ? 0 : 124) << outcome.err;
      return name;
    };
    const NamedArrays one = arrays_of(here_, run(cat("one", k), 1));
    EXPECT_EQ(find_array(one, "league/counts").shape, std::vector<int64_t>{32});
    EXPECT_GT(array_values<double>(find_array(one, "league/team_0/games")).at(0), 0) << "nobody met the pool";
    EXPECT_LT(difference(one, arrays_of(here_, run(cat("two", k), 2))), 1e-4);
    EXPECT_EQ(state_hash(here_, run(cat("again", k), 2)), state_hash(here_, cat("two", k)));
    EXPECT_LT(difference(one, arrays_of(here_, run(cat("four", k), 4))), 1e-4);
    EXPECT_LT(metrics_apart(here_, cat("one", k), cat("two", k)), kMetricsTolerance);
    EXPECT_LT(metrics_apart(here_, cat("one", k), cat("four", k)), kMetricsTolerance);
    // Begun by four and ended by one, and the other way round.
    for (const auto& [first, second] : {std::pair{4, 1}, std::pair{1, 2}}) {
      const std::string begun = run(cat("begun", k, first), first, {"--set", "train.stop_at_agent_steps=8192"});
      std::vector<std::string> words = {"resume", begun, "--set", "train.stop_at_agent_steps=none"};
      if (second > 1) words.insert(words.end(), {"--ranks", std::to_string(second)});
      const Outcome resumed = here_.run(words);
      ASSERT_EQ(resumed.code, 0) << resumed.err;
      EXPECT_LT(difference(one, arrays_of(here_, begun)), 1e-4);
      EXPECT_EQ(metrics_rows(here_, begun), 4u);
    }
    // Begun as a run of one shard, which others than before meet from then on.
    const std::string alone =
        run(cat("alone", k), 1, {"--set", "mappo.shards=1", "--set", "train.stop_at_agent_steps=8192"});
    const Outcome shared = here_.run(
        {"resume", alone, "--ranks", "2", "--set", "mappo.shards=2", "--set", "train.stop_at_agent_steps=none"});
    EXPECT_EQ(shared.code, 0) << shared.err;
    EXPECT_EQ(metrics_rows(here_, alone), 4u);
  }
}

// Without mappo.shards each rank gets one, as the run's config says from then on.
TEST_F(RankedRun, OfMappoNeedsNoSetting) {
  std::string config = kRankedMappo;
  const std::string shards = "shards: 8, ";
  config.erase(config.find(shards), shards.size());
  here_.write("plain.yaml", config);
  const Outcome outcome = here_.run({"train", "plain.yaml", "--run-dir", "run", "--ranks", "4"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(read_file(here_.path() / "run/config.yaml"), {"shards: 4"}));
}

TEST_F(RankedRun, RefusesWhatCannotBeDivided) {
  const auto refused = [&](const std::vector<std::string>& words, const Environment& environment = {}) {
    const Outcome outcome = here_.run(words, kGigastep, environment);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    return outcome.err;
  };
  EXPECT_TRUE(contains(refused(train("a", 3)), {"8 members cannot be divided among 3 ranks; nearest: 6, 12"}));
  const auto mappo = [](const std::vector<std::string>& more) {
    std::vector<std::string> words = {"train", "mappo.yaml", "--run-dir", "b", "--ranks", "2"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  EXPECT_TRUE(contains(refused(mappo({"--set", "mappo.shards=1"})),
                       {"mappo.shards: 1 cannot be divided among 2 ranks; nearest: 2"}));
  EXPECT_TRUE(contains(refused(mappo({"--set", "mappo.shards=3"})), {"3 does not divide train.n_worlds = 16"}));
  EXPECT_TRUE(contains(refused(mappo({"--set", "mappo.shards=16", "--set", "mappo.n_minibatches=16"})),
                       {"16 does not divide the 8 states of a shard"}));
  // Two worlds a shard, one of them for each team, and half of that is none.
  EXPECT_TRUE(contains(refused(mappo({"--set", "opponents.pool_size=2", "--set", "opponents.pool_share=0.4"})),
                       {"opponents.pool_share: 0.4 of train.n_worlds 16 leaves each team 0 worlds in each of "
                        "mappo.shards 8 against the pool; it needs at least 1"}));
  EXPECT_TRUE(contains(refused(mappo({"--set", "opponents.scripted_share=0.4", "--set", "mappo.shards=2", "--set",
                                      "mappo.horizon=5", "--set", "mappo.n_minibatches=40"})),
                       {"40 minibatches for the 30 states of a shard that a team learns from (opponents)"}));
  EXPECT_TRUE(contains(refused(train("c", 2), {{"RANK", "0"}, {"WORLD_SIZE", "2"}}), {"MASTER_PORT is not set"}));
  EXPECT_FALSE(here_.has("a"));
  EXPECT_TRUE(
      contains(refused(train("g", 1, {"--gpus", "2"})), {"--gpus 2: the device is cpu; --ranks shares the cores"}));
  EXPECT_TRUE(contains(refused(train("g", 2, {"--gpus", "2"})), {"--ranks cannot be given together with --gpus"}));
  EXPECT_TRUE(contains(refused(train("g", 1, {"--gpus", "2", "--device", "cuda:0"})), {"cuda:0"}));
  EXPECT_TRUE(
      contains(refused(train("g", 1, {"--gpus", "2"}), {{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_PORT", "1"}}),
               {"--gpus 2: this process is rank 0 of 2 already"}));

  // As torchrun starts them, with different configs; rank 0 serves the store.
  const Workplace other;
  other.write("es.yaml", kRankedEvolution);
  const auto second =
      other.start({"train", "es.yaml", "--seed", "2", "--run-dir", "d"}, kGigastep, rank_of_two(1, 29517));
  EXPECT_TRUE(contains(refused({"train", "es.yaml", "--run-dir", "d"}, rank_of_two(0, 29517)),
                       {"rank 1 has another program or config than rank 0", "'seed: 2' instead of 'seed: 1'"}));
  EXPECT_EQ(second->wait().code, 2);
}

}  // namespace
}  // namespace giga::test
