// RunFolder: the folder of a training run, and where in it everything is.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "io/checkpoint.hpp"
#include "io/json.hpp"
#include "io/run_lock.hpp"

namespace giga {

/// config.yaml      resolved run config
/// scenario.yaml    resolved scenario; also under the name of its file where it came from one, for config.yaml
/// run.json         seed, versions, hardware, command line; resume_NNN.json: the same of each continuation
/// metrics.csv      a row per update
/// events.out.tfevents.gigastep   the same for TensorBoard, which calls a run by its folder
/// log.txt          messages
/// checkpoints/     update_NNNNNNNN.h5, best.h5
/// report.html      curves and facts, written at the end
/// replays/         update_NNNNNNNN.replay: games of each evaluation; replays.html shows some of them
/// lock             while a process trains in it
///
/// The folder is locked while this lives (RunLock).
class RunFolder {
 public:
  static constexpr const char* kReplaysPage = "replays.html";

  /// A new run in `folder`, which must not exist, be empty or hold a barely begun run (InputError else); without one in
  /// runs/<name>, or where that is taken runs/<name>-NNN with the first number from 002 on that is free.
  static RunFolder create(const std::string& folder, const std::string& name);
  /// The folder of an earlier run, to go on with it. Throws InputError where there is none or a process works in it.
  static RunFolder open(const std::string& folder);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path config_file() const { return path_ / "config.yaml"; }
  std::filesystem::path scenario_file() const { return path_ / "scenario.yaml"; }
  std::filesystem::path info_file() const { return path_ / "run.json"; }
  std::filesystem::path metrics_file() const { return path_ / "metrics.csv"; }
  std::filesystem::path events_file() const;
  std::filesystem::path log_file() const { return path_ / "log.txt"; }
  std::filesystem::path report_file() const { return path_ / "report.html"; }
  std::filesystem::path replay_file(int64_t updates) const;
  std::filesystem::path replays_page() const { return path_ / kReplaysPage; }
  std::filesystem::path checkpoint_file(int64_t updates) const;
  std::filesystem::path best_file() const;
  const RunLock& lock() const { return lock_; }
  /// Whether this new run takes the place of one that was ended before its first checkpoint.
  bool begins_anew() const { return begins_anew_; }

  /// Writes config.yaml, scenario.yaml and run.json; `scenario_file_name`: the scenario also stands under this name,
  /// which the config names.
  void describe(const std::string& config_yaml, const std::string& scenario_yaml, const Json& info,
                const std::string& scenario_file_name = "") const;
  /// Writes those of these files that are not there, and returns their names. Throws InputError where one is missing
  /// and its text is empty.
  std::vector<std::string> describe_missing(const std::string& config_yaml, const std::string& scenario_yaml,
                                            const Json& info, const std::string& scenario_file_name = "") const;
  /// Writes config.yaml and resume_NNN.json.
  void describe_resume(const std::string& config_yaml, const Json& info) const;

  /// Keeps a replay of the games after so many updates.
  void save_replay(int64_t updates, const std::string& bytes) const;
  /// The replays up to an update, oldest first.
  std::vector<std::filesystem::path> replays(int64_t updates) const;

  /// Writes a checkpoint, also as the best one where it is that, then removes all but the newest `keep`.
  void save(const Checkpoint& checkpoint, int keep, bool is_best) const;

 private:
  explicit RunFolder(std::filesystem::path path) : path_(std::move(path)), lock_(path_) {}

  std::filesystem::path path_;
  RunLock lock_;
  bool begins_anew_ = false;
};

/// Whether a folder is that of a run: it holds config.yaml or, where that was lost, checkpoints.
bool is_run_folder(const std::filesystem::path& folder);

/// Whether a folder holds nothing but what `train` writes before its first checkpoint, so that nothing is lost where
/// the run begins anew. Who asks makes sure that no process works in it.
bool is_barely_begun(const std::filesystem::path& folder);

/// Throws InputError: `path`, a run or checkpoint that somebody named, is not there. It names the entry beside it that
/// may have been meant.
[[noreturn]] void fail_no_such_run(const std::filesystem::path& path);

/// A checkpoint, where it was found, and what is wrong with newer ones, a line each.
struct FoundCheckpoint {
  std::filesystem::path file;
  Checkpoint checkpoint;
  std::vector<std::string> damaged;
  std::vector<std::filesystem::path> damaged_files;
};

/// Reads a checkpoint file, or the newest whole one of a run folder (or of its folder of checkpoints): the best one
/// where the same under its number is damaged. A file that is named never falls back to another. Throws InputError
/// where there is none, or none that is whole.
FoundCheckpoint find_checkpoint(const std::string& path);

/// The same, but of a folder the best checkpoint, where there is one and it is whole.
FoundCheckpoint find_best_checkpoint(const std::string& path);

/// Whether a run folder has a checkpoint to go on from, best.h5 counted.
bool has_checkpoint(const std::filesystem::path& run_folder);
/// Its newest one; best.h5 where there is no other.
std::filesystem::path newest_checkpoint(const std::filesystem::path& run_folder);

/// The checkpoints of a run folder, oldest first, without best.h5.
std::vector<std::filesystem::path> list_checkpoints(const std::filesystem::path& run_folder);

/// resume_001.json, ... of a run folder, as many as are there.
std::vector<std::filesystem::path> list_resumes(const std::filesystem::path& run_folder);

/// What runs are called: by their folders. Where two folders have the same name, as much of the path is added as tells
/// them apart: "first/seed1" and "second/seed1".
std::vector<std::string> names_of_folders(const std::vector<std::filesystem::path>& folders);

/// A scenario's name or path as part of a folder's name: "maps/My game.yaml" = "My_game".
std::string folder_name_of(const std::string& scenario);

}  // namespace giga
