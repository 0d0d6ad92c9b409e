// Run folders: never overwritten, numbered, and found again by their newest checkpoint.
#include "io/run_folder.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "io/files.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

Checkpoint after(int64_t updates) {
  Checkpoint c;
  c.updates = updates;
  c.config_yaml = "seed: 1\n";
  return c;
}

/// Makes a folder the current one while it lives.
class InFolder {
 public:
  explicit InFolder(const fs::path& folder) : old_(fs::current_path()) { fs::current_path(folder); }
  ~InFolder() { fs::current_path(old_); }

 private:
  fs::path old_;
};

TEST(RunFolder, HoldsWhatItSays) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "deep/run").string(), "unused");
  run.describe("seed: 1\n", "rules: original\n", {{"seed", 1}});
  EXPECT_EQ(read_file(folder / "deep/run/config.yaml"), "seed: 1\n");
  EXPECT_EQ(read_file(folder / "deep/run/scenario.yaml"), "rules: original\n");
  EXPECT_EQ(read_file(folder / "deep/run/run.json"), "{\n  \"seed\": 1\n}\n");
  EXPECT_TRUE(fs::is_directory(folder / "deep/run/checkpoints"));
}

TEST(RunFolder, AnEmptyFolderIsTakenAFullOneRefused) {
  const TemporaryFolder folder;
  fs::create_directory(folder / "empty");
  EXPECT_NO_THROW(RunFolder::create((folder / "empty").string(), ""));
  fs::create_directory(folder / "full");
  std::ofstream(folder / "full/notes.txt") << "mine";
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "full").string(), ""); }),
                       {"is there already and not empty"}));
  EXPECT_FALSE(fs::exists(folder / "full/checkpoints"));
}

/// A run that was killed before its first checkpoint, by the first `n` of the things that it makes until then.
struct Beginning {
  std::string name, text;
};
const Beginning kBeginnings[] = {{"lock", "process 4711 on host, since 2025-01-01T00:00:00Z\n"},
                                 {"checkpoints/", ""},
                                 {"scenario.yaml.999999999.tmp", "rul"},
                                 {"scenario.yaml", "rules: original\n"},
                                 {"game.yaml", "rules: original\n"},
                                 {"run.json", "{}\n"},
                                 {"config.yaml", "seed: 1\n"},
                                 {"log.txt", "training\n"},
                                 {"metrics.csv", ""},
                                 {"events.out.tfevents.gigastep", "head"},
                                 {"checkpoints/update_00000000.h5.999999999.tmp", "half"}};

void begin_run(const fs::path& folder, size_t n) {
  fs::create_directory(folder);
  for (size_t k = 0; k < n; ++k) {
    const Beginning& made = kBeginnings[k];
    if (made.name.ends_with('/'))
      fs::create_directory(folder / made.name);
    else
      std::ofstream(folder / made.name) << made.text;
  }
}

TEST(RunFolder, WhatEndedBeforeItsFirstCheckpointBeginsAnew) {
  for (size_t n = 1; n <= std::size(kBeginnings); ++n) {
    SCOPED_TRACE(kBeginnings[n - 1].name);
    const TemporaryFolder folder;
    begin_run(folder / "run", n);
    EXPECT_TRUE(is_barely_begun(folder / "run"));
    const RunFolder run = RunFolder::create((folder / "run").string(), "");
    EXPECT_TRUE(run.begins_anew());
    for (const char* name : {"game.yaml", "log.txt", "metrics.csv", "events.out.tfevents.gigastep",
                             "scenario.yaml.999999999.tmp", "checkpoints/update_00000000.h5.4711.tmp"})
      EXPECT_FALSE(fs::exists(run.path() / name)) << name;
    EXPECT_TRUE(fs::is_directory(run.path() / "checkpoints"));
  }
  const TemporaryFolder folder;
  EXPECT_FALSE(is_barely_begun(folder.path())) << "an empty folder";
  EXPECT_FALSE(RunFolder::create((folder / "new").string(), "").begins_anew());
}

// One thing more than train writes before its first checkpoint, or one thing of these without those before it.
TEST(RunFolder, WhatSomebodyMayMissIsNotBegunAnew) {
  const Beginning more[] = {{"notes.txt", "mine"},
                            {"other.yaml", "rules: mine\n"},
                            {"notes.tmp", "mine"},
                            {"metrics.csv", "update\r\n1\r\n"},
                            {"checkpoints/best.h5", "one"},
                            {"checkpoints/update_00000000.h5", "one"},
                            {"lock", "my key"},
                            {"resume_001.json", "{}"}};
  for (const Beginning& one : more) {
    SCOPED_TRACE(one.name);
    const TemporaryFolder folder;
    begin_run(folder / "run", std::size(kBeginnings));
    std::ofstream(folder / ("run/" + one.name)) << one.text;
    EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "run").string(), ""); }),
                         {"a run is never overwritten"}));
    EXPECT_EQ(read_file(folder / ("run/" + one.name)), one.text);
    EXPECT_EQ(read_file(folder / "run/log.txt"), "training\n");
  }
  for (const char* name : {"config.yaml", "scenario.yaml", "metrics.csv"}) {
    const TemporaryFolder folder;
    fs::create_directory(folder / "run");
    std::ofstream(folder / (std::string("run/") + name)) << "";
    EXPECT_FALSE(is_barely_begun(folder / "run")) << name << " alone";
  }
}

TEST(RunFolder, AFileOfThatNameIsRefused) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "file").string(), ""); }), {"file"}));
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "file/run").string(), ""); }), {"file"}));
}

// Else the newest checkpoint would say that it is the best one, and nobody would write that one again.
TEST(RunFolder, ABestCheckpointThatCannotBeWrittenLeavesNoNewestOne) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "unused");
  run.save(after(2), 3, false);
  fs::create_directory(run.best_file());
  EXPECT_ANY_THROW(run.save(after(3), 3, true));
  EXPECT_FALSE(fs::exists(run.checkpoint_file(3)));
  EXPECT_TRUE(fs::exists(run.checkpoint_file(2)));
}

TEST(RunFolder, NamesAreCountedUp) {
  const TemporaryFolder folder;
  const InFolder here(folder.path());
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed1").path(), "runs/game-mappo-seed1");
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed1").path(), "runs/game-mappo-seed1-002");
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed2").path(), "runs/game-mappo-seed2");
}

std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  return names;
}

TEST(RunFolder, KeepsTheNewestCheckpointsAndTheBest) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "");
  std::ofstream(run.checkpoint_file(1).string() + ".999999999.tmp") << "half";
  for (const int64_t updates : {1, 2, 3, 10, 123456789}) run.save(after(updates), 2, updates == 3);
  EXPECT_EQ(names_in(folder / "run/checkpoints"),
            (std::set<std::string>{"update_00000010.h5", "update_123456789.h5", "best.h5"}));
  EXPECT_EQ(read_checkpoint(run.best_file()).updates, 3);
  EXPECT_EQ(list_checkpoints(folder / "run"),
            (std::vector<fs::path>{run.checkpoint_file(10), run.checkpoint_file(123456789)}));
}

TEST(RunFolder, FindsTheNewestCheckpoint) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "");
  const std::string path = run.path().string();
  EXPECT_TRUE(contains(input_error_of([&] { find_checkpoint(path); }), {"holds no checkpoint"}));
  run.save(after(2), 5, false);
  run.save(after(11), 5, false);
  EXPECT_EQ(find_checkpoint(path).file, run.checkpoint_file(11));
  EXPECT_EQ(find_checkpoint(path).checkpoint.updates, 11);
  EXPECT_EQ(find_checkpoint((run.path() / "checkpoints").string()).file, run.checkpoint_file(11));
  EXPECT_EQ(find_checkpoint(run.checkpoint_file(2).string()).checkpoint.updates, 2);
  EXPECT_TRUE(contains(input_error_of([&] { find_checkpoint((folder / "none").string()); }),
                       {"there is no checkpoint or run folder"}));
  const std::string twin = path + "2";  // one letter more
  EXPECT_EQ(input_error_of([&] { find_checkpoint(twin); }),
            "there is no checkpoint or run folder " + twin + "; nearest: '" + path + "'");
}

TEST(RunFolder, ADamagedCheckpointIsNamedAndThePreviousOneTaken) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "");
  for (const int64_t updates : {1, 2, 3}) run.save(after(updates), 5, updates == 1);
  write_file(run.checkpoint_file(3), read_file(run.checkpoint_file(3)).substr(0, 900));
  const std::string path = run.path().string();
  FoundCheckpoint found = find_checkpoint(path);
  EXPECT_EQ(found.checkpoint.updates, 2);
  ASSERT_EQ(found.damaged.size(), 1u);
  EXPECT_TRUE(contains(found.damaged[0], {"update_00000003.h5: is truncated: 900 of"}));
  EXPECT_EQ(found.damaged_files, std::vector<fs::path>{run.checkpoint_file(3)});
  // A file that is named is that file or nothing.
  EXPECT_TRUE(contains(input_error_of([&] { find_checkpoint(run.checkpoint_file(3).string()); }), {"is truncated"}));

  // The best one, where it is newer: it was written as update 3 was, which is damaged.
  const std::string best = read_file(run.best_file());
  write_file(run.best_file(), encode_checkpoint(after(3)));
  found = find_checkpoint(path);
  EXPECT_EQ(found.file, run.best_file());
  EXPECT_EQ(found.checkpoint.updates, 3);
  const std::string damaged = read_file(run.checkpoint_file(3));
  fs::remove(run.checkpoint_file(3));  // who takes the newest out means to go on from one before
  EXPECT_EQ(find_checkpoint(path).file, run.checkpoint_file(2));
  write_file(run.checkpoint_file(3), damaged);
  write_file(run.best_file(), best);  // that of update 1
  EXPECT_EQ(find_checkpoint(path).file, run.checkpoint_file(2));

  for (const int64_t updates : {1, 2}) write_file(run.checkpoint_file(updates), "");
  found = find_checkpoint(path);  // the best one, rather than nothing
  EXPECT_EQ(found.file, run.best_file());
  EXPECT_EQ(found.damaged.size(), 3u);
  write_file(run.best_file(), "nonsense");
  EXPECT_TRUE(contains(input_error_of([&] { find_checkpoint(path); }),
                       {"no checkpoint of", "is whole", "update_00000003.h5: is truncated",
                        "update_00000001.h5: is empty", "best.h5: is not a gigastep checkpoint"}));
}

TEST(RunFolder, IsOpenedAgainAndDescribedAgain) {
  const TemporaryFolder folder;
  const std::string path = (folder / "run").string();
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::open(path); }), {"there is no run folder"}));
  fs::create_directory(path);
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::open(path); }), {"no config.yaml"}));
  RunFolder::create(path, "").describe("seed: 1\n", "", Json::object());
  std::ofstream(folder / "run/report.html.999999999.tmp") << "half";
  for (int n = 1; n <= 2; ++n) RunFolder::open(path).describe_resume("seed: 1\nmore: 2\n", {{"n", n}});
  EXPECT_EQ(read_file(folder / "run/config.yaml"), "seed: 1\nmore: 2\n");
  EXPECT_EQ(read_file(folder / "run/run.json"), "{}\n");
  EXPECT_FALSE(fs::exists(folder / "run/report.html.999999999.tmp")) << "what a killed process left";
  EXPECT_EQ(read_file(folder / "run/resume_001.json"), "{\n  \"n\": 1\n}\n");
  EXPECT_EQ(read_file(folder / "run/resume_002.json"), "{\n  \"n\": 2\n}\n");
}

TEST(RunFolder, WhatIsMissingIsDescribedAgain) {
  using Names = std::vector<std::string>;
  const TemporaryFolder folder;
  const std::string path = (folder / "run").string();
  {
    const RunFolder run = RunFolder::create(path, "");
    run.describe("seed: 1\n", "rules: original\n", {{"seed", 1}}, "game.yaml");
    run.save(after(2), 5, false);
    EXPECT_EQ(run.describe_missing("other", "other", {{"seed", 2}}, "game.yaml"), Names());
    EXPECT_EQ(read_file(run.config_file()), "seed: 1\n");
    for (const char* name : {"config.yaml", "scenario.yaml", "game.yaml", "run.json"}) fs::remove(run.path() / name);
  }
  const RunFolder run = RunFolder::open(path);  // its checkpoint tells that it is a run
  EXPECT_TRUE(contains(input_error_of([&] {
                         run.describe_missing("seed: 1\n", "", {{"seed", 1}});
                       }),
                       {"scenario.yaml is missing", "does not hold it"}));
  EXPECT_FALSE(fs::exists(run.config_file()));
  EXPECT_EQ(run.describe_missing("seed: 1\n", "rules: original\n", {{"seed", 1}}, "game.yaml"),
            (Names{"scenario.yaml", "game.yaml", "run.json", "config.yaml"}));
  EXPECT_EQ(read_file(run.path() / "game.yaml"), "rules: original\n");
  EXPECT_EQ(read_file(run.info_file()), "{\n  \"seed\": 1\n}\n");
}

TEST(RunFolder, OneProcessAtATime) {
  const TemporaryFolder folder;
  const std::string path = (folder / "run").string();
  {
    const RunFolder run = RunFolder::create(path, "");
    run.describe("seed: 1\n", "", Json::object());
    const std::string owner = cat("is in use by process ", ::getpid(), " on ");
    EXPECT_TRUE(contains(input_error_of([&] { RunFolder::open(path); }), {path.c_str(), owner.c_str()}));
    EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create(path, ""); }), {path.c_str(), owner.c_str()}));
    EXPECT_TRUE(fs::exists(folder / "run/lock"));
  }
  EXPECT_FALSE(fs::exists(folder / "run/lock"));
  EXPECT_NO_THROW(RunFolder::open(path));
}

// What a killed process leaves: the file with its name, held by nobody.
TEST(RunFolder, AStaleLockIsRecognised) {
  const TemporaryFolder folder;
  const std::string path = (folder / "run").string();
  RunFolder::create(path, "").describe("seed: 1\n", "", Json::object());
  const pid_t child = ::fork();
  if (child == 0) {
    const RunFolder run = RunFolder::open(path);
    ::kill(::getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_TRUE(contains(read_file(folder / "run/lock"), {cat("process ", child, " on ").c_str()}));
  EXPECT_EQ(lock_owner(path), std::nullopt);
  const RunFolder run = RunFolder::open(path);
  ASSERT_TRUE(run.lock().stale_owner().has_value());
  EXPECT_TRUE(contains(*run.lock().stale_owner(), {cat("process ", child, " on ").c_str(), "since "}));
}

TEST(RunFolder, NamesFromScenarios) {
  EXPECT_EQ(folder_name_of("identical_5_vs_5_void"), "identical_5_vs_5_void");
  EXPECT_EQ(folder_name_of("../games/My game.yaml"), "My_game");
}

}  // namespace
}  // namespace giga::test
