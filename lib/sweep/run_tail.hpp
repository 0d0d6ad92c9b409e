// RunTail: how far a run is that goes on in another process, read from what has come to its metrics.csv.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "sweep/spec.hpp"

namespace giga {

/// Reads only what is new since the last look, so that looking often costs little. A file that was cut, as `resume`
/// does with rows behind its checkpoint, is read anew.
class RunTail {
 public:
  /// `spec` must live as long. The folder need not be there yet.
  RunTail(const SweepSpec& spec, const std::filesystem::path& run);

  /// Reads the rows that are complete. Throws InputError where the file is damaged or lacks a column.
  void look();

  double agent_steps() const { return agent_steps_; }        ///< of the last row; 0: there is none
  double update_seconds() const { return update_seconds_; }  ///< of all updates together
  double speed() const { return speed_; }                    ///< agent-steps per second of the last update
  std::optional<double> metric() const;                      ///< so far; none: not known yet

 private:
  void restart();
  void take(const std::string& rows);

  const SweepSpec& spec_;
  std::filesystem::path file_;
  uint64_t read_ = 0;   // bytes, up to the end of a line
  std::string header_;  // with the end of its line; empty until it is there
  double agent_steps_ = 0, update_seconds_ = 0, speed_ = 0;
  std::vector<std::vector<double>> known_;  // values of the metric's columns
};

}  // namespace giga
