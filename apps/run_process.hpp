// RunProcess: a gigastep of this very program that runs beside this one, and what it takes to bring a run folder to a
// number of agent-steps whatever became of it before.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "learn/run_config.hpp"

namespace giga {

class RunProcess {
 public:
  /// `gigastep arguments...`; what it prints goes behind what is in the log. It is asked to stop (SIGTERM) when this
  /// process ends, however that comes.
  RunProcess(const std::vector<std::string>& arguments, const std::filesystem::path& log);
  /// Asks it to stop, and waits.
  ~RunProcess();
  RunProcess(const RunProcess&) = delete;
  RunProcess& operator=(const RunProcess&) = delete;

  /// The exit code, as a shell has it, once it has ended.
  std::optional<int> ended();
  void stop() const;

 private:
  int pid_;
  std::optional<int> code_;
};

/// A run that is wanted: its folder, its config with changes, and where it stops.
struct WantedRun {
  std::filesystem::path folder, config;
  std::vector<std::string> overrides;
  std::optional<int64_t> stop_at;  ///< agent-steps; none = the end
};

/// Removes a folder that has no checkpoint to go on from.
void clear_beginning(const WantedRun& run);
/// What brings it there: `train`, or `resume` where there is a checkpoint.
std::vector<std::string> arguments_for(const WantedRun& run);

/// Writes config.yaml into a folder, from which a run trains as this one would; with its scenario.
void write_config_files(const std::filesystem::path& folder, const LoadedRun& run);

/// The last lines of a log, for messages.
std::string tail_of(const std::filesystem::path& log);

}  // namespace giga
