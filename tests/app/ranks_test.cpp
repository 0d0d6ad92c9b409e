// One training by several processes: the same result as by one, and an end for all where one is gone.
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/run_folder.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kConfig = R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {algorithm: openai_es, total_agent_steps: 8000, n_threads: 1}
population: {population_size: 8, episodes_per_member: 2, max_steps: 60, actor: {hidden: [8]}}
opponents: {pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp}
eval: {episodes: 8, every_updates: 2, record: 0}
checkpoint: {every_updates: 1}
)";

// An update: 16 worlds x 8 steps x 4 agents = 512 agent-steps; a shard: 2 worlds x 8 steps = 16 states, 4 in a
// minibatch.
constexpr const char* kMappo = R"(scenario: identical_2_vs_2_fobs_vec_void_disc
device: cpu
train: {algorithm: mappo, n_worlds: 16, total_agent_steps: 1536, n_threads: 1, desynchronize: true}
mappo: {horizon: 8, n_minibatches: 4, n_epochs: 2, shards: 8, actor: {hidden: [8, 8]}, critic: {hidden: [8, 8]}}
eval: {episodes: 8, every_updates: 0, record: 0}
checkpoint: {every_updates: 1}
)";

/// Of what updates of mappo report, which sums of another order change.
constexpr double kMetricsTolerance = 1e-3;

NamedArrays arrays_of(const Workplace& here, const std::string& run) {
  return find_checkpoint((here.path() / run).string()).checkpoint.arrays;
}

/// Where two states differ by more than rounding: the greatest difference of fp32 numbers, relative to 1 or the number;
/// infinite where shapes or integers differ.
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

/// The environment of a rank of two, as torchrun makes it; rank 0 serves the store.
Environment rank_of_two(int rank, int port) {
  return {{"RANK", std::to_string(rank)},
          {"LOCAL_RANK", std::to_string(rank)},
          {"WORLD_SIZE", "2"},
          {"MASTER_ADDR", "127.0.0.1"},
          {"MASTER_PORT", std::to_string(port)}};
}

class RankedRun : public ::testing::Test {
 protected:
  RankedRun() {
    here_.write("es.yaml", kConfig);
    here_.write("mappo.yaml", kMappo);
  }
  std::vector<std::string> train(const std::string& run, int ranks, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"train", "es.yaml", "--run-dir", run};
    if (ranks > 1) words.insert(words.end(), {"--ranks", std::to_string(ranks)});
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// Processes that were started by this test and are ranks: their ids by rank.
  static std::vector<int> ranks_of(int parent) {
    std::vector<int> pids;
    std::ifstream children(cat("/proc/", parent, "/task/", parent, "/children"));
    for (int pid = 0; children >> pid;) pids.push_back(pid);
    return pids;
  }
  Workplace here_;
};

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
      {"--set", "mappo.critic.kind=state", "--set", "train.opponent=circle", "--set", "mappo.target_kl=0.001"}};
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
                               kMappo));
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
  std::string config = kMappo;
  const std::string shards = "shards: 8, ";
  config.erase(config.find(shards), shards.size());
  here_.write("plain.yaml", config);
  const Outcome outcome = here_.run({"train", "plain.yaml", "--run-dir", "run", "--ranks", "4"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(read_file(here_.path() / "run/config.yaml"), {"shards: 4"}));
}

TEST_F(RankedRun, OfMappoEndsWhereAGradientIsNotFinite) {
  // A first step of 1e38 makes the second minibatch's gradient infinite, in both ranks.
  const Outcome outcome = here_.run({"train", "mappo.yaml", "--run-dir", "run", "--ranks", "2", "--set",
                                     "mappo.learning_rate=1e38", "--set", "mappo.max_grad_norm=0"});
  EXPECT_EQ(outcome.code, 3) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"the gradient of the actor of team 0 held a NaN or an infinity at update 1, "
                                     "minibatch 2, in each of the 2 ranks; the batch of rank 0 is in "}));
  const NamedArrays kept = arrays_of(here_, "run/diverged_update_1_team_0.h5");
  EXPECT_EQ(find_array(kept, "simulator/x").shape, (std::vector<int64_t>{16, 4}));  // the worlds of both
}

// The place of an agent in a world of one rank, in the checkpoint that both go on from.
TEST_F(RankedRun, OfMappoNamesTheRankWhoseNumbersAreNotFinite) {
  ASSERT_EQ(here_.run({"train", "mappo.yaml", "--run-dir", "begun", "--set", "train.stop_at_agent_steps=512"}).code,
            124);
  for (const int rank : {0, 1}) {
    const std::string run = cat("faulty_", rank);
    fs::copy(here_.path() / "begun", here_.path() / run, fs::copy_options::recursive);
    FoundCheckpoint found = find_checkpoint((here_.path() / run).string());
    for (NamedArray& array : found.checkpoint.arrays) {
      if (array.name != "simulator/x") continue;
      std::vector<float> x = array_values<float>(array);  // [16 worlds, 4 agents], 8 worlds of each rank
      x[static_cast<size_t>((8 * rank + 3) * 4)] = NAN;
      std::memcpy(array.bytes.data(), x.data(), array.bytes.size());
    }
    write_checkpoint(found.file, found.checkpoint);
    const Outcome outcome =
        here_.run({"resume", run, "--ranks", "2", "--set", "train.stop_at_agent_steps=none"}, kGigastep);
    EXPECT_EQ(outcome.code, 3) << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {cat("the observations of team 0 held a NaN or an infinity at update 2, in rank ",
                                           rank, " of 2; the batch of rank ", rank, " is in ")}));
    // Which is that of the worlds where it began.
    const NamedArrays kept = arrays_of(here_, run + "/diverged_update_2_team_0.h5");
    const std::vector<float> obs = array_values<float>(find_array(kept, "batch/obs"));
    EXPECT_TRUE(std::any_of(obs.begin(), obs.end(), [](float o) { return !std::isfinite(o); })) << obs.size();
    EXPECT_EQ(find_array(kept, "batch/obs").shape.at(0), find_array(kept, "batch/index").shape.at(0));
  }
}

TEST_F(RankedRun, IsStoppedBySignalAndGoesOnWithAnotherNumberOfRanks) {
  ASSERT_EQ(here_.run(train("whole", 1)).code, 0);
  for (const auto& [first, second] : {std::pair{2, 1}, std::pair{1, 2}}) {
    const std::string run = cat("first_by_", first);
    const Outcome stopped = here_.run(train(run, first, {"--set", "train.stop_at_agent_steps=3000"}));
    ASSERT_EQ(stopped.code, 124) << stopped.err;
    std::vector<std::string> words = {"resume", run, "--set", "train.stop_at_agent_steps=none"};
    if (second > 1) words.insert(words.end(), {"--ranks", std::to_string(second)});
    const Outcome resumed = here_.run(words);
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_EQ(state_hash(here_, run), state_hash(here_, "whole"));
  }
  // A signal to one rank, of which the other learns.
  const auto process = here_.start(train("signal", 2, {"--set", "train.total_agent_steps=1e9"}));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "signal") >= 2; }));
  const std::vector<int> pids = ranks_of(process->pid());
  ASSERT_EQ(pids.size(), 2u);
  ::kill(pids[1], SIGTERM);
  const Outcome outcome = process->wait();
  EXPECT_EQ(outcome.code, 128 + SIGTERM) << outcome.err;
  EXPECT_TRUE(contains(outcome.err, {"the state is saved"}));
  // One to the process that started them.
  const auto interrupted = here_.start(train("interrupted", 2, {"--set", "train.total_agent_steps=1e9"}));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "interrupted") >= 2; }));
  ::kill(interrupted->pid(), SIGINT);
  EXPECT_EQ(interrupted->wait().code, 128 + SIGINT);
}

TEST_F(RankedRun, EndsWhereARankIsKilled) {
  for (size_t victim = tests_run_in_full() ? 0 : 1; victim < 2; ++victim) {
    const std::string run = cat("killed_", victim);
    const auto process = here_.start(train(run, 2, {"--set", "train.total_agent_steps=1e9"}));
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, run) >= 2; }));
    const std::vector<int> pids = ranks_of(process->pid());
    ASSERT_EQ(pids.size(), 2u);
    ::kill(pids[victim], SIGKILL);
    const auto begin = std::chrono::steady_clock::now();
    const Outcome outcome = process->wait();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(30));
    EXPECT_EQ(outcome.code, 1);
    EXPECT_TRUE(contains(outcome.err, {cat("rank ", victim, " of 2 was ended by signal 9")}));
    // What was saved is whole.
    const Outcome inspected = here_.run({"inspect", run});
    EXPECT_EQ(inspected.code, 0) << inspected.err;
  }
}

// Rank 0 lives, but does not come back from writing the checkpoint of update 2 (fault/fault.c).
TEST_F(RankedRun, EndsWhereARankHangs) {
  constexpr int kPort = 29521;
  std::vector<std::string> words = train("hung", 1, {"--set", "train.total_agent_steps=1e9"});
  words.insert(words.end(), {"--rank-timeout", "6"});  // longer than another process takes to start
  Environment hangs = rank_of_two(0, kPort);
  hangs.insert(
      hangs.end(),
      {{"LD_PRELOAD", fault_library()}, {"FAULT_PATH", "update_00000002"}, {"FAULT_AT", "1"}, {"FAULT_ERRNO", "-1"}});
  const Workplace other;
  other.write("es.yaml", kConfig);
  const auto first = here_.start(words, kGigastep, hangs);
  const auto second = other.start(words, kGigastep, rank_of_two(1, kPort));
  const Outcome outcome = second->wait();
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(contains(outcome.err, {"rank 1: rank 0 of 2 lives, but hangs: no answer within 6 s"}));
  first->send(SIGKILL);
  first->wait();
  // What was saved before is whole.
  EXPECT_EQ(find_checkpoint((here_.path() / "hung").string()).checkpoint.updates, 1);
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
  other.write("es.yaml", kConfig);
  const auto second =
      other.start({"train", "es.yaml", "--seed", "2", "--run-dir", "d"}, kGigastep, rank_of_two(1, 29517));
  EXPECT_TRUE(contains(refused({"train", "es.yaml", "--run-dir", "d"}, rank_of_two(0, 29517)),
                       {"rank 1 has another program or config than rank 0", "'seed: 2' instead of 'seed: 1'"}));
  EXPECT_EQ(second->wait().code, 2);
}

// ---- A GPU for each rank: skipped where there are fewer than two ---------------------------------------------------

// An update: 128 worlds x 8 steps x 4 agents.
constexpr const char* kGpuMappo = R"(scenario: identical_2_vs_2_fobs_vec_void_disc
device: cuda
train: {algorithm: mappo, n_worlds: 128, total_agent_steps: 12288, desynchronize: true}
mappo: {horizon: 8, n_minibatches: 4, n_epochs: 2, shards: 2, actor: {hidden: [32, 32]}, critic: {hidden: [32, 32]}}
eval: {episodes: 8, every_updates: 0, record: 0}
checkpoint: {every_updates: 1}
)";

class RankedRunGpu : public RankedRun {
 protected:
  void SetUp() override {
    here_.write("gpu.yaml", kGpuMappo);
    const Outcome probe = here_.run({"train", "es.yaml", "--device", "cuda", "--gpus", "256"});
    ASSERT_EQ(probe.code, 2) << probe.err;
    if (contains(probe.err, {"0 GPUs found"}) || contains(probe.err, {"1 GPU is found"})) GTEST_SKIP() << probe.err;
    if (contains(probe.err, {"GPUs are found"})) return;
    FAIL() << probe.err;
  }
  std::string run(const std::string& name, int gpus, const std::vector<std::string>& more = {}, int code = 0) {
    std::vector<std::string> words = {"train", "gpu.yaml", "--run-dir", name};
    if (gpus > 1) words.insert(words.end(), {"--gpus", std::to_string(gpus)});
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = here_.run(words);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    err_ = outcome.err;
    return name;
  }
  std::string err_;
};

/// The greatest difference of what the teams have learned, relative to 1 or the number.
double learned_difference(const NamedArrays& a, const NamedArrays& b) {
  const auto learned = [](const NamedArrays& all) {
    NamedArrays teams;
    for (const NamedArray& array : all)
      if (array.name.starts_with("team_")) teams.push_back(array);
    return teams;
  };
  return difference(learned(a), learned(b));
}

TEST_F(RankedRunGpu, OfMappoEqualsThatOfOneGpuToRounding) {
  // By the fused kernels, by LibTorch, and with scripts and a pool. A step is at most 1e-3, and there are 24 of them:
  // halves of a gradient that are not added up would show as 1e-2.
  constexpr double kTolerance = 1e-3;
  const std::vector<std::vector<std::string>> settings = {
      {},
      {"--set", "mappo.fused=false", "--set", "mappo.obs_norm=true", "--set", "mappo.advantage_norm=batch"},
      {"--set", "opponents.pool_size=2", "--set", "opponents.pool_every_updates=1", "--set", "opponents.pool_share=0.5",
       "--set", "opponents.scripted_share=0.25"}};
  for (size_t k = 0; k < (tests_run_in_full() ? settings.size() : 1); ++k) {
    SCOPED_TRACE(k);
    const std::vector<std::string>& set = settings[k];
    const char* const way = k == 1 ? "by LibTorch" : "acts and learns by fused kernels";
    const NamedArrays one = arrays_of(here_, run(cat("one", k), 1, set));
    const std::string two = run(cat("two", k), 2, set);
    EXPECT_TRUE(contains(err_, {"shared by 2 ranks", way}));
    const double apart = learned_difference(one, arrays_of(here_, two));
    std::cout << way << ": two GPUs and one differ by " << apart << std::endl;
    EXPECT_LT(apart, kTolerance);
    // The same ranks give the same bits.
    EXPECT_EQ(state_hash(here_, run(cat("again", k), 2, set)), state_hash(here_, two));
    EXPECT_EQ(timeless_metrics(here_, cat("again", k)), timeless_metrics(here_, two));
    if (k == 1) continue;
    // Begun by two and ended by one, and the other way round.
    for (const auto& [first, second] : {std::pair{2, 1}, std::pair{1, 2}}) {
      if (first == 1 && !tests_run_in_full()) continue;
      std::vector<std::string> begin = set;
      begin.insert(begin.end(), {"--set", "train.stop_at_agent_steps=4096"});
      const std::string begun = run(cat("begun", k, "by", first), first, begin, 124);
      std::vector<std::string> words = {"resume", begun, "--set", "train.stop_at_agent_steps=none"};
      if (second > 1) words.insert(words.end(), {"--gpus", "2"});
      const Outcome resumed = here_.run(words);
      ASSERT_EQ(resumed.code, 0) << resumed.err;
      EXPECT_EQ(metrics_rows(here_, begun), 3u);
      EXPECT_LT(learned_difference(one, arrays_of(here_, begun)), kTolerance);
    }
  }
}

TEST_F(RankedRunGpu, OfEvolutionEqualsThatOfOneGpuBitForBit) {
  for (const int gpus : {1, 2}) {
    std::vector<std::string> words = train(cat("by_", gpus), 1, {"--device", "cuda", "--gpus", std::to_string(gpus)});
    const Outcome outcome = here_.run(words);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
  }
  EXPECT_EQ(state_hash(here_, "by_2"), state_hash(here_, "by_1"));
  EXPECT_EQ(timeless_metrics(here_, "by_2"), timeless_metrics(here_, "by_1"));
}

TEST_F(RankedRunGpu, EndsWhereARankIsKilled) {
  for (size_t victim = tests_run_in_full() ? 0 : 1; victim < 2; ++victim) {
    const std::string name = cat("killed_", victim);
    const auto process = here_.start({"train", "gpu.yaml", "--run-dir", name, "--gpus", "2", "--set",
                                      "train.total_agent_steps=1e12", "--set", "checkpoint.every_updates=0"});
    ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, name) >= 2; }));
    const std::vector<int> pids = ranks_of(process->pid());
    ASSERT_EQ(pids.size(), 2u);
    ::kill(pids[victim], SIGKILL);
    const auto begin = std::chrono::steady_clock::now();
    const Outcome outcome = process->wait();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::cout << "rank " << victim << " killed: all ended after " << seconds << " s\n" << outcome.err << std::endl;
    EXPECT_LT(seconds, 15);
    EXPECT_EQ(outcome.code, 1);
    EXPECT_TRUE(contains(outcome.err, {cat("rank ", 1 - victim, ": rank ", victim, " of 2 was ended by signal 9")}));
  }
}

TEST_F(RankedRunGpu, EndsWhereAGradientIsNotFinite) {
  run("run", 2, {"--set", "mappo.learning_rate=1e38", "--set", "mappo.max_grad_norm=0"}, 3);
  EXPECT_TRUE(contains(err_, {"held a NaN or an infinity at update 1", "rank 0 keeps the batch"}));
}

// As under torchrun, where nobody else tells of the one that is stopped.
TEST_F(RankedRunGpu, EndsWhereARankIsStopped) {
  if (!tests_run_in_full()) GTEST_SKIP() << "takes half a minute";
  const std::vector<std::string> words = {"train",     "gpu.yaml",
                                          "--run-dir", "stopped",
                                          "--set",     "train.total_agent_steps=1e12",
                                          "--set",     "checkpoint.every_updates=0"};
  const auto first = here_.start(words, kGigastep, rank_of_two(0, 29519)),
             second = here_.start(words, kGigastep, rank_of_two(1, 29519));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(here_, "stopped") >= 2; }));
  ::kill(second->pid(), SIGSTOP);
  const auto begin = std::chrono::steady_clock::now();
  const Outcome outcome = first->wait();
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  std::cout << "rank 1 stopped: rank 0 ended after " << seconds << " s\n" << outcome.err << std::endl;
  ::kill(second->pid(), SIGKILL);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_LT(seconds, 35);
  EXPECT_TRUE(contains(outcome.err, {"rank 1 of 2 has not been heard of for 20 s: it is dead, stopped or cut off"}));
}

}  // namespace
}  // namespace giga::test
