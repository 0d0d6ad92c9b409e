// Run folders: never overwritten, numbered, and found again by their newest checkpoint.
#include "io/run_folder.hpp"

#include <gtest/gtest.h>

#include <fstream>
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
  run.describe("seed: 1\n", "rules: original\n", Json::object().set("seed", 1));
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

TEST(RunFolder, AFileOfThatNameIsRefused) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "file").string(), ""); }), {"file"}));
  EXPECT_TRUE(contains(input_error_of([&] { RunFolder::create((folder / "file/run").string(), ""); }), {"file"}));
}

TEST(RunFolder, NamesAreCountedUp) {
  const TemporaryFolder folder;
  const InFolder here(folder.path());
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed1").path(), "runs/game-mappo-seed1-001");
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed1").path(), "runs/game-mappo-seed1-002");
  EXPECT_EQ(RunFolder::create("", "game-mappo-seed2").path(), "runs/game-mappo-seed2-001");
}

TEST(RunFolder, KeepsTheNewestCheckpoints) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "");
  std::ofstream(run.checkpoint_file(1).string() + ".99.tmp") << "half";
  for (const int64_t updates : {1, 2, 3, 10, 123456789}) run.save(after(updates), 2);
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder / "run/checkpoints"))
    names.insert(entry.path().filename().string());
  EXPECT_EQ(names, (std::set<std::string>{"update_00000010.h5", "update_123456789.h5"}));
}

TEST(RunFolder, ResolvesFilesAndFolders) {
  const TemporaryFolder folder;
  const RunFolder run = RunFolder::create((folder / "run").string(), "");
  EXPECT_TRUE(contains(input_error_of([&] { resolve_checkpoint(run.path().string()); }), {"holds no checkpoint"}));
  run.save(after(2), 5);
  run.save(after(11), 5);
  EXPECT_EQ(resolve_checkpoint(run.path().string()), run.checkpoint_file(11));
  EXPECT_EQ(resolve_checkpoint((run.path() / "checkpoints").string()), run.checkpoint_file(11));
  EXPECT_EQ(resolve_checkpoint(run.checkpoint_file(2).string()), run.checkpoint_file(2));
  EXPECT_TRUE(contains(input_error_of([&] { resolve_checkpoint((folder / "none").string()); }),
                       {"there is no checkpoint or run folder"}));
}

TEST(RunFolder, NamesFromScenarios) {
  EXPECT_EQ(folder_name_of("identical_5_vs_5_void"), "identical_5_vs_5_void");
  EXPECT_EQ(folder_name_of("../games/My game.yaml"), "My_game");
}

}  // namespace
}  // namespace giga::test
