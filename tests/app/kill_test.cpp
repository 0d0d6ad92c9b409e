// The process dies, or the disk fails, at every single file operation of a run (thinned: at some of them): the run
// always goes on from a whole checkpoint and ends as if nothing had happened.
#include <gtest/gtest.h>

#include <cerrno>
#include <filesystem>
#include <iostream>
#include <memory>
#include <set>
#include <string>

#include "io/run_folder.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

/// A run of four updates, each of which is saved, with a fault at one of its file operations.
class KilledRun : public ::testing::Test {
 protected:
  /// The same run without a fault, to compare with.
  static void SetUpTestSuite() {
    here_ = std::make_unique<Workplace>();
    here_->write("short.yaml", kShortConfig);
    const Outcome whole = run("whole", 0, 0);
    ASSERT_EQ(whole.code, 0) << whole.err;
    hash_ = state_hash(*here_, "whole");
    metrics_ = timeless_metrics(*here_, "whole");
    replays_ = replays("whole");
    ASSERT_FALSE(replays_.empty());
    n_operations_ = static_cast<int>(here_->read("count_whole").size());
  }
  static void TearDownTestSuite() { here_.reset(); }
  void SetUp() override { ASSERT_GT(n_operations_, 0); }

  /// The names of a run's replays, which a thread writes beside the updates, in order.
  static std::set<std::string> replays(const std::string& name) {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(here_->path() / name / "replays"))
      names.insert(entry.path().filename().string());
    return names;
  }

  /// Trains in the folder `name`; the fault strikes at the file operation `at` below it.
  static Outcome run(const std::string& name, int at, int error) {
    return here_->run({"train", "short.yaml", "--run-dir", name, "--quiet"}, kGigastep,
                      {{"LD_PRELOAD", fault_library()},
                       {"FAULT_PATH", name + "/"},
                       {"FAULT_AT", std::to_string(at)},
                       {"FAULT_ERRNO", std::to_string(error)},
                       {"FAULT_COUNT", (here_->path() / ("count_" + name)).string()}});
  }

  /// After the fault: what is there is whole, and the run goes on to the same end. Returns whether there was a
  /// checkpoint to go on from.
  static bool expect_goes_on(const std::string& name) {
    for (const fs::path& file : list_checkpoints(here_->path() / name)) EXPECT_NO_THROW(read_checkpoint(file)) << file;
    const Outcome resumed = here_->run({"resume", name, "--quiet"});
    if (resumed.code == 2) {
      // Only before the very first checkpoint: nothing was learned, nothing is lost, and it says so.
      EXPECT_TRUE(contains(resumed.err, {"holds no checkpoint"}) || contains(resumed.err, {"no config.yaml"}) ||
                  contains(resumed.err, {"there is no run folder"}))
          << resumed.err;
      EXPECT_EQ(metrics_rows(*here_, name), 0u);
      const Outcome anew = run(name, 0, 0);
      EXPECT_EQ(anew.code, 0) << anew.err;
      EXPECT_EQ(state_hash(*here_, name), hash_);
      return false;
    }
    EXPECT_EQ(resumed.code, 0) << resumed.err;
    EXPECT_EQ(state_hash(*here_, name), hash_);
    EXPECT_EQ(metrics_difference(timeless_metrics(*here_, name), metrics_), "");
    EXPECT_EQ(replays(name), replays_) << "a checkpoint has not waited for the games of its evaluation";
    for (const auto& entry : fs::recursive_directory_iterator(here_->path() / name))
      EXPECT_NE(entry.path().extension(), ".tmp") << entry.path() << " was left";
    return true;
  }

  static std::unique_ptr<Workplace> here_;
  static std::string hash_, metrics_;
  static std::set<std::string> replays_;
  static int n_operations_;
};
std::unique_ptr<Workplace> KilledRun::here_;
std::string KilledRun::hash_, KilledRun::metrics_;
std::set<std::string> KilledRun::replays_;
int KilledRun::n_operations_ = 0;

TEST_F(KilledRun, BySigkillAtEveryFileOperation) {
  int kills = 0, resumes = 0;
  const int stride = thinned(18);
  for (int at = (stride + 1) / 2; at <= n_operations_; at += stride) {
    const std::string name = "kill_" + std::to_string(at);
    SCOPED_TRACE(name);
    ASSERT_EQ(run(name, at, 0).code, 128 + SIGKILL);
    ++kills;
    resumes += expect_goes_on(name) ? 1 : 0;
    if (HasFailure()) return;
    fs::remove_all(here_->path() / name);
  }
  std::cout << "killed at " << kills << " of " << n_operations_ << " file operations, resumed " << resumes
            << " times, nothing to resume " << kills - resumes << " times (before the first checkpoint)\n";
  EXPECT_GE(resumes * stride, 60) << "of " << kills;
}

TEST_F(KilledRun, ByAFolderThatCannotBeWrittenAnyMore) {
  const Outcome failed = run("closed", n_operations_ / 2, EACCES);
  EXPECT_EQ(failed.code, 1);
  EXPECT_TRUE(contains(failed.err, {"Permission denied", "closed/"}));
  EXPECT_TRUE(expect_goes_on("closed"));
}

TEST_F(KilledRun, ByAFullDisk) {
  int failures = 0, resumes = 0;
  const int stride = thinned(5);
  for (int at = 2; at <= n_operations_; at += 4 * stride) {
    const std::string name = "full_" + std::to_string(at);
    SCOPED_TRACE(name);
    const Outcome failed = run(name, at, ENOSPC);
    // What fails last may be what nobody needs: removing an old checkpoint, or the lock.
    if (failed.code != 0) {
      EXPECT_NE(failed.code, 3);
      EXPECT_TRUE(contains(failed.err, {"No space left on device", name})) << failed.err;
      if (here_->has(name + "/checkpoints/update_00000000.h5")) {
        EXPECT_TRUE(contains(failed.err, {"to go on from there: ", " resume " + name}));
      }
      ++failures;
      resumes += expect_goes_on(name) ? 1 : 0;
    }
    if (HasFailure()) return;
    fs::remove_all(here_->path() / name);
  }
  std::cout << "the disk was full " << failures << " times, the run went on " << resumes << " times\n";
  EXPECT_GE(resumes * stride, 12) << "of " << failures;
}

}  // namespace
}  // namespace giga::test
