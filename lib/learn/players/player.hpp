// Player: who takes part in matches and ratings: a checkpoint, a run, an exported policy, a TorchScript module, a
// scripted team or a mixed one, from how a user names it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/memory.hpp"
#include "learn/players/mind.hpp"
#include "learn/run_config.hpp"
#include "rollout/policy_controllers.hpp"

namespace giga {

struct FoundCheckpoint;

struct PlayerOptions {
  Device device;
  bool trust = false;   ///< open TorchScript modules, which can run any code
  bool greedy = false;  ///< policies take their most likely action instead of drawing one
};

class Player {
 public:
  /// `text`, in this order:
  ///   the name of a script (Scripted);
  ///   a run folder: the policies of its best checkpoint if it has one, else of its newest;
  ///   an exported policy: its folder, its safetensors file, or with `trust` a TorchScript module, from here or not;
  ///   a mixed team: a YAML file that lists some of these (mixed_team.hpp);
  ///   a checkpoint file.
  /// Throws InputError where it is none of these or cannot be read.
  static Player load(const std::string& text, const PlayerOptions& options);
  /// The same of a checkpoint that was read; its name is that of the file.
  static Player of_checkpoint(const FoundCheckpoint& found, const PlayerOptions& options);

  /// The text that it was loaded from, or what it was renamed to.
  const std::string& name() const { return name_; }
  void rename(const std::string& name) { name_ = name; }
  /// None where it is no script.
  std::optional<Scripted> script() const { return script_; }

  /// What is known of the training of a checkpoint or an exported policy.
  struct Origin {
    std::string file;
    std::string scenario_name;
    int64_t updates = 0, agent_steps = 0;
    double seconds = 0;                 ///< of training; checkpoints only
    LoadedRun run;                      ///< configuration and scenario
    std::vector<std::string> warnings;  ///< newer or better files that are damaged, a line each
  };
  /// Null of scripts, of mixed teams, and of TorchScript modules from elsewhere.
  const Origin* origin() const { return origin_.get(); }
  /// Those who play in a mixed team; else this alone. Valid while this lives, and is not moved.
  std::vector<const Player*> members() const;
  bool is_mixed() const { return !mixed_.empty(); }

  /// Whether it can play team `side`: a checkpoint has a policy for each team that learned, a mixed team plays what all
  /// its members can, all others play both.
  bool can_play(int side) const;
  /// Throws InputError where its policy cannot play a scenario, as check_fits of export/observation_layout.hpp does,
  /// and names the keys in which `scenario`, that of `spec`, differs.
  void check_plays(const SimSpec& spec, const Scenario* scenario = nullptr) const;
  /// What moves team `side` in a game of a scenario; valid while this lives, and until the next call with a scenario of
  /// other observations or actions. Throws InputError where can_play is false, or the scenario's observations or
  /// actions are not those of the policy.
  std::unique_ptr<TeamController> controller(int side, const SimSpec& spec);
  /// The networks behind that controller, for observers of matches; nothing of scripts and mixed teams. No critic where
  /// it was trained to read the true state of another scenario.
  Mind mind(int side, const SimSpec& spec) const;

  /// A game with the observations that its policy is given: the egocentric view only where it was trained with it and
  /// does not compute it itself.
  SimSpec seen_by(const SimSpec& spec) const;
  /// An exported policy that does.
  bool computes_view() const;
  /// Whether its policy reads images in the place of numbers.
  bool reads_image() const;

 private:
  class Exported;
  static Player load_mixed(const std::string& text, const PlayerOptions& options);
  std::unique_ptr<TeamController> checkpoint_controller(int side, const SimSpec& spec) const;

  std::string name_;
  bool greedy_ = false;
  std::optional<Scripted> script_;
  std::shared_ptr<const Policy> policy_[kNTeams];         // by team, of checkpoints; null where the team did not learn
  std::shared_ptr<const ValueFunction> values_[kNTeams];  // likewise; null where it had no critic
  std::shared_ptr<Exported> exported_;
  std::shared_ptr<const Origin> origin_;
  std::vector<Player> mixed_;
};

/// The script of that name.
std::optional<Scripted> find_script(const std::string& name);

}  // namespace giga
