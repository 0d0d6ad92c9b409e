// RunFolder: the folder of a training run, and where in it everything is.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "io/checkpoint.hpp"
#include "io/json.hpp"

namespace giga {

/// config.yaml      resolved run config
/// scenario.yaml    resolved scenario
/// run.json         seed, versions, hardware, command line
/// metrics.csv      a row per update
/// log.txt          messages
/// checkpoints/     update_NNNNNNNN.h5
class RunFolder {
 public:
  /// A new run in `folder`, which must not exist or be empty (InputError else); without one in runs/<name>-NNN, NNN
  /// being the first number that is free.
  static RunFolder create(const std::string& folder, const std::string& name);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path config_file() const { return path_ / "config.yaml"; }
  std::filesystem::path scenario_file() const { return path_ / "scenario.yaml"; }
  std::filesystem::path info_file() const { return path_ / "run.json"; }
  std::filesystem::path metrics_file() const { return path_ / "metrics.csv"; }
  std::filesystem::path log_file() const { return path_ / "log.txt"; }
  std::filesystem::path checkpoint_file(int64_t updates) const;

  /// Writes what a run is known by.
  void describe(const std::string& config_yaml, const std::string& scenario_yaml, const Json& info) const;

  /// Writes a checkpoint, then removes all but the newest `keep`.
  void save(const Checkpoint& checkpoint, int keep) const;

 private:
  explicit RunFolder(std::filesystem::path path) : path_(std::move(path)) {}

  std::filesystem::path path_;
};

/// The newest checkpoint of a run folder.
std::optional<std::filesystem::path> latest_checkpoint(const std::filesystem::path& run_folder);

/// A checkpoint file as it is; of a run folder the newest one. Throws InputError where there is none.
std::filesystem::path resolve_checkpoint(const std::string& path);

/// A scenario's name or path as part of a folder's name: "maps/My game.yaml" = "My_game".
std::string folder_name_of(const std::string& scenario);

}  // namespace giga
