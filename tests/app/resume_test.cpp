// Stopping and resuming: a run that was stopped and went on is the same, bit for bit, as one that was not.
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>

#include "io/run_folder.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

/// Trains 40 updates at once, to compare with.
class Resume : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    here_ = new Workplace();
    here_->write("short.yaml", kShortConfig);
    const Outcome whole = train("whole");
    ASSERT_EQ(whole.code, 0) << whole.err;
    hash_ = new std::string(state_hash(*here_, "whole"));
    metrics_ = new std::string(timeless_metrics(*here_, "whole"));
  }
  static void TearDownTestSuite() {
    delete here_;
    delete hash_;
    delete metrics_;
  }

  static std::vector<std::string> arguments(const std::string& run, const std::string& more = "") {
    std::vector<std::string> list = {"train", "short.yaml", "--run-dir", run, "--set", "train.total_agent_steps=10240"};
    if (!more.empty()) list.insert(list.end(), {"--set", more});
    return list;
  }
  static Outcome train(const std::string& run, const std::string& more = "") {
    return here_->run(arguments(run, more));
  }

  /// Starts a run, sends the signal once there are rows, and gives what came of it.
  static Outcome interrupted(const std::string& run, int signal, const std::string& more = "") {
    const auto process = here_->start(arguments(run, more));
    EXPECT_TRUE(wait_until([&] { return metrics_rows(*here_, run) >= 3; }));
    process->send(signal);
    return process->wait();
  }

  static void expect_same_as_whole(const std::string& run) {
    EXPECT_EQ(state_hash(*here_, run), *hash_);
    EXPECT_EQ(metrics_difference(timeless_metrics(*here_, run), *metrics_), "");
    EXPECT_EQ(fs::file_size(here_->path() / run / "events.out.tfevents.gigastep"),
              fs::file_size(here_->path() / "whole/events.out.tfevents.gigastep"));
    EXPECT_FALSE(here_->has(run + "/lock"));
  }

  static Workplace* here_;
  static std::string *hash_, *metrics_;
};
Workplace* Resume::here_ = nullptr;
std::string *Resume::hash_ = nullptr, *Resume::metrics_ = nullptr;

TEST_F(Resume, AfterEachSignalBitForBit) {
  ::signal(SIGHUP, SIG_DFL);  // programs that nohup started ignore it, and so would those that this test starts
  const std::pair<int, int> codes[] = {{SIGINT, 130}, {SIGTERM, 143}, {SIGUSR1, 138}, {SIGHUP, 129}};
  const auto stride = static_cast<size_t>(thinned(4));
  for (size_t k = 0; k < std::size(codes); k += stride) {
    const auto [signal, code] = codes[k];
    const std::string run = cat("signal_", signal);
    SCOPED_TRACE(run);
    const Outcome stopped = interrupted(run, signal);
    ASSERT_EQ(stopped.code, code) << stopped.err;
    EXPECT_TRUE(contains(stopped.err, {"stopped after update", "the state is saved", "resume " + run}));
    EXPECT_TRUE(here_->has(run + "/report.html") || stopped.err.find("report") == std::string::npos);
    const FoundCheckpoint saved = find_checkpoint((here_->path() / run).string());
    EXPECT_GE(saved.checkpoint.updates, 3);
    EXPECT_LT(saved.checkpoint.updates, 40);
    EXPECT_EQ(static_cast<size_t>(saved.checkpoint.updates), metrics_rows(*here_, run)) << "not saved at the stop";
    const Outcome resumed = here_->run({"resume", run});
    ASSERT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_TRUE(contains(resumed.err, {"going on after update"}));
    EXPECT_TRUE(contains(resumed.out, {"against", "report: ", "next: "}));
    expect_same_as_whole(run);
    EXPECT_TRUE(contains(here_->read(run + "/resume_001.json"), {"\"updates\"", "\"changes\": []", "hardware"}));
  }
}

TEST_F(Resume, AgainAndAgain) {
  const std::string run = "often";
  const auto stride = static_cast<size_t>(thinned(8));
  ASSERT_EQ(interrupted(run, SIGTERM).code, 143);
  int stops = 1;
  for (; stops < 20; ++stops) {
    const size_t rows = metrics_rows(*here_, run);
    const auto process = here_->start({"resume", run, "--quiet"});
    ASSERT_TRUE(
        wait_until([&] { return metrics_rows(*here_, run) > rows + stride || metrics_rows(*here_, run) == 40; }));
    process->send(SIGTERM);
    const Outcome outcome = process->wait();
    if (outcome.code == 0) break;
    ASSERT_EQ(outcome.code, 143) << outcome.err;
  }
  EXPECT_GT(stops, 1);
  expect_same_as_whole(run);
}

// Killed without any warning: what was written after the last checkpoint is cut off.
TEST_F(Resume, AfterSigkillRowsBehindTheCheckpointAreCutOff) {
  const std::string run = "killed";
  const auto process = here_->start(arguments(run, "checkpoint.every_updates=7"));
  EXPECT_TRUE(wait_until([&] { return metrics_rows(*here_, run) >= 10; }));
  process->send(SIGKILL);
  ASSERT_EQ(process->wait().code, 128 + SIGKILL);
  EXPECT_TRUE(here_->has(run + "/lock"));
  const Outcome resumed = here_->run({"resume", run});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_TRUE(contains(resumed.err, {"took over the run folder from process", "which is gone"}));
  expect_same_as_whole(run);
}

// Settings that were changed stay so where the run is killed before its next checkpoint; else this one, which was
// complete before, would be so again.
TEST_F(Resume, AfterSigkillWhatWasChangedStaysChanged) {
  fs::copy(here_->path() / "whole", here_->path() / "longer", fs::copy_options::recursive);
  const auto process = here_->start({"resume", "longer", "--set", "train.total_agent_steps=1e9", "--set",
                                     "checkpoint.every_updates=1000000", "--set", "eval.every_updates=0"});
  EXPECT_TRUE(wait_until([&] { return metrics_rows(*here_, "longer") >= 43; }));
  process->send(SIGKILL);
  ASSERT_EQ(process->wait().code, 128 + SIGKILL);
  // 60 updates of 256 agent-steps.
  const Outcome resumed = here_->run({"resume", "longer", "--set", "train.stop_at_agent_steps=15360"});
  EXPECT_EQ(resumed.code, 124) << resumed.err;
  EXPECT_FALSE(contains(resumed.err, {"differs"})) << resumed.err;
  EXPECT_EQ(metrics_rows(*here_, "longer"), 60u);
}

TEST_F(Resume, AfterMaxWallTime) {
  const std::string run = "timed";
  // 1 s is enough for some updates, not for 400,000.
  const Outcome stopped = here_->run({"train", "short.yaml", "--run-dir", run, "--set", "train.total_agent_steps=1e8",
                                      "--set", "train.max_wall_time=1s", "--set", "mappo.schedule=constant"});
  ASSERT_EQ(stopped.code, 124) << stopped.err;
  EXPECT_TRUE(contains(stopped.err, {"train.max_wall_time is over", "the state is saved",
                                     "resume timed, for another 1s", "--set train.max_wall_time=none"}));
  const int64_t updates = find_checkpoint((here_->path() / run).string()).checkpoint.updates;
  EXPECT_GT(updates, 0);
  const std::string total = std::to_string((updates + 3) * 256);
  const Outcome resumed = here_->run({"resume", run, "--set", "train.total_agent_steps=" + total});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(find_checkpoint((here_->path() / run).string()).checkpoint.updates, updates + 3);
  EXPECT_TRUE(contains(here_->read(run + "/resume_001.json"), {"train.total_agent_steps: 100000000 -> " + total}));
  EXPECT_TRUE(contains(here_->read(run + "/config.yaml"), {"total_agent_steps: " + total}));
}

TEST_F(Resume, ASecondInterruptEndsAtOnce) {
  // An update of 4096 worlds x 64 steps, 50 epochs: many seconds.
  const auto process =
      here_->start({"train", "short.yaml", "--run-dir", "slow", "--set", "train.n_worlds=4096", "--set",
                    "mappo.horizon=64", "--set", "mappo.n_epochs=1000", "--set", "train.total_agent_steps=1e8"});
  // The checkpoint of update 0 is there: the signals are listened to from then on.
  ASSERT_TRUE(wait_until([&] { return here_->has("slow/checkpoints/update_00000000.h5"); }));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  process->send(SIGINT);
  // It is answered at once, in the middle of the update.
  std::this_thread::sleep_for(std::chrono::milliseconds(1000));
  process->send(SIGINT);
  const auto start = std::chrono::steady_clock::now();
  const Outcome outcome = process->wait();
  EXPECT_EQ(outcome.code, 130);
  EXPECT_TRUE(contains(outcome.err, {"finishing update 1", "Ctrl-C again ends without saving"}));
  // Playing or learning, by how fast the machine is.
  EXPECT_TRUE(contains(outcome.err, {"\nupdate 1 of 191: "})) << "the first update shows how it goes on";
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
  EXPECT_EQ(metrics_rows(*here_, "slow"), 0u) << "the update was finished first";
}

// Fewer agent-steps than are done would end a run that was to go on, and drop what else is set.
TEST_F(Resume, ARunIsNotEndedByAShorterLength) {
  ASSERT_EQ(train("shorter", "train.stop_at_agent_steps=2560").code, 124);
  const Outcome resumed =
      here_->run({"resume", "shorter", "--set", "train.total_agent_steps=256", "--set", "mappo.learning_rate=0.5"});
  EXPECT_EQ(resumed.code, 2) << resumed.out;
  EXPECT_TRUE(contains(resumed.err, {"--set train.total_agent_steps: 256 is not more than the ",
                                     " agent-steps that the run has done of 10240"}))
      << resumed.err;
}

TEST_F(Resume, ACompleteRunIsLeftAsItIs) {
  const std::string before = here_->read("whole/metrics.csv");
  const Outcome resumed = here_->run({"resume", "whole"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_TRUE(contains(resumed.out, {"is complete: 40 updates", "train.total_agent_steps=N, more than these"}));
  EXPECT_EQ(resumed.err, "");
  const Outcome in_vain = here_->run({"resume", "whole", "--set", "mappo.learning_rate=0.5"});
  EXPECT_EQ(in_vain.code, 0) << in_vain.err;
  EXPECT_TRUE(contains(in_vain.err, {"--set mappo.learning_rate=0.5 changes nothing: the run is complete"}));
  EXPECT_EQ(here_->read("whole/metrics.csv"), before);
  EXPECT_FALSE(here_->has("whole/resume_001.json"));
  EXPECT_FALSE(contains(resumed.out, {"report"})) << resumed.out;
  const std::filesystem::path report = here_->path() / "whole/report.html", away = here_->path() / "away.html";
  std::filesystem::rename(report, away);
  EXPECT_TRUE(contains(here_->run({"resume", "whole"}).out, {"its report is missing", "report whole"}));
  std::filesystem::rename(away, report);
}

TEST_F(Resume, WhatMayNotChangeIsRefusedBeforeAnythingIsTouched) {
  const std::string before = here_->read("whole/config.yaml");
  const Outcome refused =
      here_->run({"resume", "whole", "--set", "train.n_worlds=32", "--set", "mappo.actor.hidden=[16]"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_TRUE(contains(refused.err, {"train.n_worlds: 32 instead of 16", "so many worlds", "mappo.actor.hidden",
                                     "what may change: train.total_agent_steps"}));
  EXPECT_EQ(here_->read("whole/config.yaml"), before);
}

TEST_F(Resume, OneProcessAtATime) {
  const std::string run = "busy";
  const auto process = here_->start(arguments(run, "train.total_agent_steps=1e7"));
  ASSERT_TRUE(wait_until([&] { return metrics_rows(*here_, run) >= 3; }));
  const Workplace other;  // its own files for the output
  const std::string folder = (here_->path() / run).string();
  other.write("short.yaml", kShortConfig);
  const std::string owner = cat("is in use by process ", process->pid(), " on ");
  for (const Outcome& second :
       {other.run({"resume", folder}), other.run({"train", "short.yaml", "--run-dir", folder})}) {
    EXPECT_EQ(second.code, 2);
    EXPECT_TRUE(contains(second.err, {owner}));
  }
  EXPECT_EQ(other.run({"eval", folder, "--vs", "random", "--episodes", "8", "--device", "cpu"}).code, 0)
      << "evaluating a run that goes on is fine";
  process->send(SIGTERM);
  EXPECT_EQ(process->wait().code, 143);
}

TEST_F(Resume, ADamagedNewestCheckpointIsNamedAndSetAside) {
  const std::string run = "damaged";
  ASSERT_EQ(interrupted(run, SIGTERM).code, 143);
  const FoundCheckpoint newest = find_checkpoint((here_->path() / run).string());
  const std::string name = run + "/checkpoints/" + newest.file.filename().string();
  here_->write(name, here_->read(name).substr(0, 3000));

  const Outcome by_name = here_->run({"resume", name});
  EXPECT_EQ(by_name.code, 2) << "a file that is named never falls back";
  EXPECT_TRUE(contains(by_name.err, {newest.file.filename().string() + ": is truncated: 3000 of"}));
  const std::string best = run + "/checkpoints/best.h5";
  ASSERT_TRUE(here_->has(best));
  here_->write(best, here_->read(best).substr(0, 3000));  // evaluation looks at this one first
  const Outcome evaluated = here_->run({"eval", run, "--vs", "random", "--episodes", "8", "--device", "cpu"});
  EXPECT_EQ(evaluated.code, 0);
  EXPECT_TRUE(contains(evaluated.err, {"warning: ", "is truncated", "is taken"}));
  const Outcome exploited =
      here_->run({"exploit", run, "--agent-steps", "256", "--episodes", "2", "--device", "cpu", "--out", "responses"});
  EXPECT_EQ(exploited.code, 0);
  EXPECT_TRUE(contains(exploited.err, {"warning: ", "is truncated", "is taken"}));
  const std::string path = "./" + run;
  for (const auto& [whom, size] :
       {std::pair{"train.opponent=" + path, "0"}, std::pair{"opponents.policies=[" + path + "]", "1"}}) {
    const Outcome met =
        here_->run({"train", "short.yaml", "--run-dir", std::string("met") + size, "--set", whom, "--set",
                    std::string("opponents.pool_size=") + size, "--set", "train.total_agent_steps=256"});
    EXPECT_EQ(met.code, 0) << met.err;
    EXPECT_TRUE(contains(met.err, {"warning: ", "is truncated", "is taken"})) << whom;
  }

  const Outcome resumed = here_->run({"resume", run});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_TRUE(contains(resumed.err, {"warning: ", "is truncated: 3000 of", "going on from"}));
  EXPECT_TRUE(here_->has(name + ".damaged"));
  EXPECT_TRUE(contains(resumed.err, {"best.h5: is truncated: 3000 of", "the best evaluation from here on is kept"}));
  EXPECT_TRUE(here_->has(best + ".damaged"));
  EXPECT_NO_THROW(read_checkpoint(here_->path() / best)) << "of the evaluations that followed one is the best";
  expect_same_as_whole(run);
}

TEST_F(Resume, RefusesARunWhoseFilesWereCutAndLeavesItAlone) {
  const std::string run = "cut", events = run + "/events.out.tfevents.gigastep";
  ASSERT_EQ(interrupted(run, SIGTERM).code, 143);
  const std::string config = here_->read(run + "/config.yaml"), metrics = here_->read(run + "/metrics.csv");
  const std::string whole = here_->read(events);
  here_->write(events, whole.substr(0, 10));
  const Outcome refused = here_->run({"resume", run, "--set", "train.max_wall_time=1h"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_TRUE(contains(refused.err, {"events.out.tfevents.gigastep: it has 10 bytes, the checkpoint says",
                                     "move it away, and it is begun anew"}));
  EXPECT_EQ(here_->read(run + "/config.yaml"), config);
  EXPECT_EQ(here_->read(run + "/metrics.csv"), metrics);
  EXPECT_FALSE(here_->has(run + "/resume_001.json"));

  here_->write(events, whole);
  ASSERT_EQ(here_->run({"resume", run}).code, 0);
  expect_same_as_whole(run);
}

// The rows of before are gone; all that follow are the same.
TEST_F(Resume, MissingFiguresAreBegunAnew) {
  const std::string run = "rowless";
  ASSERT_EQ(interrupted(run, SIGTERM).code, 143);
  const int64_t updates = find_checkpoint((here_->path() / run).string()).checkpoint.updates;
  for (const char* name : {"metrics.csv", "events.out.tfevents.gigastep"}) fs::remove(here_->path() / run / name);
  const std::string gone = cat(" is missing and begun anew: what it held up to update ", updates, " is gone");
  const Outcome resumed = here_->run({"resume", run});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_TRUE(contains(
      resumed.err, {"warning: rowless/metrics.csv" + gone, "warning: rowless/events.out.tfevents.gigastep" + gone}));
  EXPECT_EQ(state_hash(*here_, run), *hash_);
  const CsvTable table = parse_csv(here_->read(run + "/metrics.csv"));
  ASSERT_EQ(table.rows.size(), static_cast<size_t>(40 - updates));
  EXPECT_EQ(table.cell(0, "update"), std::to_string(updates + 1));
  EXPECT_TRUE(here_->has(run + "/report.html"));
  const Outcome report = here_->run({"report", run, "--out", "late.html"});
  EXPECT_EQ(report.code, 0) << report.err;
}

// Where a run has lost its rows and stops before the next one, its checkpoint knows that there are none.
TEST_F(Resume, FiguresBegunAnewGoOnAfterAnotherStop) {
  const std::string run = "rowless_twice";
  ASSERT_EQ(here_->run(arguments(run, "train.stop_at_agent_steps=768")).code, 124);  // 3 updates of 256
  fs::remove(here_->path() / run / "metrics.csv");
  const Outcome stopped = here_->run({"resume", run});  // at the same place: it does nothing more
  EXPECT_EQ(stopped.code, 124) << stopped.err;
  const Outcome resumed = here_->run({"resume", run, "--set", "train.stop_at_agent_steps=none"});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_FALSE(contains(resumed.err, {"begun anew"}));
  EXPECT_EQ(metrics_rows(*here_, run), 37u);  // 40 - 3
}

TEST_F(Resume, AnEditOfConfigYamlIsNamedAndHasNoEffect) {
  const std::string config = here_->read("whole/config.yaml"), steps = "total_agent_steps: 10240";
  const size_t at_steps = config.find(steps);
  ASSERT_NE(at_steps, std::string::npos);
  const std::string told = "warning: whole/config.yaml differs from what the checkpoint holds";
  EXPECT_FALSE(contains(here_->run({"resume", "whole"}).err, {told}));
  std::string edited = config;
  edited.replace(at_steps, steps.size(), "total_agent_steps: 20480");
  here_->write("whole/config.yaml", edited);
  const Outcome resumed = here_->run({"resume", "whole"});
  EXPECT_TRUE(contains(resumed.err, {told + " (train.total_agent_steps)", "resume --set key=value changes settings"}));
  EXPECT_TRUE(contains(resumed.out, {"is complete: 40 updates"}));
  here_->write("whole/config.yaml", "no: config");
  EXPECT_TRUE(contains(here_->run({"resume", "whole"}).err, {told + ": "}));
  here_->write("whole/config.yaml", config);
}

// What is there when a process is killed before it has opened its log.
TEST_F(Resume, ARunWithoutACheckpointIsBegunAnewByTrain) {
  const std::string run = "early";
  here_->write(run + "/lock", "process 4711 on host, since 2025-01-01T00:00:00Z\n");
  fs::create_directory(here_->path() / run / "checkpoints");
  for (const char* name : {"scenario.yaml", "run.json", "config.yaml"})
    here_->write(run + "/" + name, here_->read(std::string("whole/") + name));
  const Outcome refused = here_->run({"resume", run});
  EXPECT_EQ(refused.code, 2);
  EXPECT_TRUE(contains(refused.err, {"the folder early holds no checkpoint", "nothing is lost",
                                     " train early/config.yaml --run-dir early"}));
  const Outcome trained = here_->run({"train", run + "/config.yaml", "--run-dir", run});
  ASSERT_EQ(trained.code, 0) << trained.err;
  EXPECT_TRUE(contains(trained.err, {"was ended before its first checkpoint: it begins anew"}));
  EXPECT_EQ(state_hash(*here_, run), *hash_);
  EXPECT_EQ(metrics_rows(*here_, run), 40u);
}

TEST_F(Resume, WhatTheFolderHasLostIsWrittenAgainFromItsCheckpoint) {
  const std::string run = "lost";
  ASSERT_EQ(interrupted(run, SIGTERM).code, 143);
  const std::string config = here_->read(run + "/config.yaml"), scenario = here_->read(run + "/scenario.yaml");
  const auto lose = [&] {
    for (const char* name : {"config.yaml", "scenario.yaml", "run.json"}) fs::remove(here_->path() / run / name);
  };
  lose();
  const Outcome resumed = here_->run({"resume", run});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  const std::string told = "written again from update_";
  EXPECT_TRUE(contains(resumed.err, {"missing in lost", told, "scenario.yaml, run.json, config.yaml"}));
  EXPECT_TRUE(contains(here_->read(run + "/log.txt"), {told}));
  EXPECT_EQ(here_->read(run + "/config.yaml"), config);
  EXPECT_EQ(here_->read(run + "/scenario.yaml"), scenario);
  EXPECT_TRUE(contains(here_->read(run + "/run.json"), {"\"seed\": 1", "\"restored_from\": \"update_"}));
  EXPECT_TRUE(here_->has(run + "/report.html")) << "it reads all three";
  expect_same_as_whole(run);

  lose();
  const std::string newest = run + "/checkpoints/update_00000040.h5";
  EXPECT_TRUE(contains(here_->run({"resume", newest}).err, {"written again from update_00000040.h5"}))
      << "of a complete run too";
  EXPECT_EQ(here_->read(run + "/config.yaml"), config);
  EXPECT_FALSE(contains(here_->run({"resume", run}).err, {told}));
}

TEST_F(Resume, ANamedCheckpointMustBeTheNewest) {
  const Outcome older = here_->run({"resume", "whole/checkpoints/update_00000039.h5"});
  EXPECT_EQ(older.code, 2);
  EXPECT_TRUE(contains(older.err, {"is not the newest checkpoint", "update_00000040.h5"}));
  EXPECT_EQ(here_->run({"resume", "whole/checkpoints/update_00000040.h5"}).code, 0);
  here_->write("elsewhere.h5", here_->read("whole/checkpoints/update_00000040.h5"));
  EXPECT_TRUE(
      contains(here_->run({"resume", "elsewhere.h5"}).err, {"does not lie in the checkpoints of a run folder"}));
  EXPECT_EQ(here_->run({"resume", "nowhere"}).code, 2);
}

// It is of another command, and the training is done.
TEST_F(Resume, ADamagedRatingDoesNotMakeItFail) {
  ASSERT_EQ(train("rated", "train.stop_at_agent_steps=5120").code, 124);
  fs::create_directory(here_->path() / "rated/ratings");
  here_->write("rated/ratings/ratings.json", "[");
  const Outcome resumed = here_->run({"resume", "rated", "--set", "train.stop_at_agent_steps=none"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_TRUE(contains(resumed.out + resumed.err, {"warning: the report was not written: ", "ratings.json"}));
  EXPECT_EQ(resumed.out.find("report: "), std::string::npos) << resumed.out;
  EXPECT_EQ(state_hash(*here_, "rated"), *hash_);
}

TEST_F(Resume, TheBestCheckpointIsThatOfTheBestEvaluation) {
  // The weaker team's win rate after each evaluation, as metrics.csv has it.
  const CsvTable table = parse_csv(here_->read("whole/metrics.csv"));
  double best = -1;
  std::string best_update;
  for (size_t row = 0; row < table.rows.size(); ++row) {
    if (table.cell(row, "win_rate_0_vs_random").empty()) continue;
    const double score = std::min(std::stod(table.cell(row, "win_rate_0_vs_random")),
                                  std::stod(table.cell(row, "win_rate_1_vs_random")));
    // Of equal ones the newest that is saved anyway: here every checkpoint.every_updates.
    if (score < best) continue;
    best = score;
    best_update = table.cell(row, "update");
  }
  const Document json =
      parse_yaml_text(here_->run({"inspect", "whole/checkpoints/best.h5", "--json", "-"}).out, "json");
  EXPECT_EQ(at(json, {"updates"}).text, best_update);
  EXPECT_EQ(number_at(json, {"best_score"}), best);
}

TEST_F(Resume, InspectShowsEveryArray) {
  const Outcome inspect = here_->run({"inspect", "whole"});
  ASSERT_EQ(inspect.code, 0) << inspect.err;
  EXPECT_TRUE(contains(inspect.out, {"format 3, written by gigastep", "scenario identical_1_vs_1_fobs_vec_void_disc",
                                     "40 updates, 10240 agent-steps", "simulator/x", "[16, 2]",
                                     "team_1/critic_adam/moment1", "sha256 " + *hash_}));
  EXPECT_NE(state_hash(*here_, "whole/checkpoints/update_00000039.h5"), *hash_);
}

}  // namespace
}  // namespace giga::test
