// ConfigCheck: where an algorithm says what is wrong in the combination of a run's keys and with the scenario.
#pragma once

#include <string>
#include <vector>

#include "learn/run_config.hpp"

namespace giga {

class ConfigCheck {
 public:
  ConfigCheck(const RunConfig& run_config, const KeyPositions& given, Errors& errors)
      : config(run_config), given_(given), errors_(errors) {}

  const RunConfig& config;
  const Scenario* scenario = nullptr;  ///< null where it could not be read
  const SimSpec* spec = nullptr;       ///< compiled; null likewise
  bool has_begun = false;              ///< read from a checkpoint: what was once allowed must stay readable

  /// Whether the keys have the values that the user meant.
  bool known(const std::vector<std::string>& keys) const;
  bool scenario_knows(const std::string& key) const;
  /// An error at the place of a key.
  void fail(const std::string& key, const std::string& message);

  /// An error where a setting was changed that means nothing to the algorithm.
  void means_nothing(const std::string& key, bool changed, const std::string& instead);
  /// Whether `train.precision` is fp16, and the error that the run cannot have it.
  bool wants_fp16() const;
  void refuse_fp16(const std::string& reason);
  /// An error where a network reads what the scenario does not give its agents. `group`: of its settings, as
  /// "mappo.actor".
  void inputs_are_there(const std::string& group, const NetworkConfig& network);
  /// An error where the deviation of continuous actions begins outside its bounds; not of runs that have begun.
  void log_std_fits(const std::string& group, const ActorConfig& actor);

 private:
  void image_is_there(const std::string& group, const NetworkConfig& network);

  const KeyPositions& given_;
  Errors& errors_;
};

}  // namespace giga
