#include "learn/players/player.hpp"

#include <algorithm>
#include <filesystem>

#include "config/fields.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "export/export.hpp"
#include "io/run_folder.hpp"
#include "learn/mixed_team.hpp"
#include "learn/players/mixed_controller.hpp"
#include "learn/players/policies.hpp"
#include "learn/players/value_function.hpp"
#include "policy/actor.hpp"
#include "scenario/policy_shape.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

[[noreturn]] void fail_unknown(const std::string& text) {
  if (text.find_first_of("/\\.") != std::string::npos) fail_no_such_run(text);
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  throw InputError(cat("'", text, "' is neither a scripted team nor a file or folder", nearest_hint(text, names),
                       "; scripted teams: ", join(names)));
}

Player::Origin origin_of(const Manifest& manifest, const std::string& file) {
  const PolicyOrigin& from = manifest.origin;
  Player::Origin origin;
  origin.file = file;
  origin.scenario_name = from.scenario_name;
  origin.updates = from.updates;
  origin.agent_steps = from.agent_steps;
  try {
    origin.run = load_run_config_text(from.config_yaml, from.scenario_yaml);
  } catch (const InputError& e) {
    throw InputError(cat("the manifest of ", file, ": ", e.what()));
  }
  origin.run.spec.name = from.scenario_name;
  return origin;
}

}  // namespace

/// An exported policy, which is made for the scenario that it plays.
class Player::Exported {
 public:
  Exported(ExportedPolicy found, Device device) : found_(std::move(found)), device_(device) {}

  const ExportedPolicy& found() const { return found_; }
  bool reads_image() const { return found_.manifest && found_.manifest->shape.reads_image(); }
  /// That was read last; its policy is null before.
  const ReadPolicy& last_read() const { return read_; }
  const ReadPolicy& policy_for(const SimSpec& spec) {
    MadeFor wanted{interface_of(spec, reads_image()), row_view(spec), spec.params.limit_x, spec.params.limit_y};
    if (read_.policy && made_for_.serves(wanted)) return read_;
    read_ = read_exported_policy(found_, spec, device_);
    made_for_ = std::move(wanted);
    return read_;
  }

 private:
  ExportedPolicy found_;
  Device device_;
  /// What the policy is read for: it may compute the egocentric view, which depends on the map's size.
  struct MadeFor {
    PolicyInterface interface;
    std::optional<RowView> view;
    float limit_x = 0, limit_y = 0;
    bool serves(const MadeFor& o) const {
      return interface.fits(o.interface) && view == o.view && limit_x == o.limit_x && limit_y == o.limit_y;
    }
  };
  ReadPolicy read_;
  MadeFor made_for_;
};

std::optional<Scripted> find_script(const std::string& name) {
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  for (size_t k = 0; k < names.size(); ++k)
    if (name == names[k]) return static_cast<Scripted>(k);
  return std::nullopt;
}

Player Player::load(const std::string& text, const PlayerOptions& options) {
  Player player;
  player.name_ = text;
  player.greedy_ = options.greedy;
  player.script_ = find_script(text);
  if (player.script_) return player;
  std::error_code code;
  if (!fs::exists(text, code)) fail_unknown(text);
  if (names_mixed_team(text)) return load_mixed(text, options);
  if (is_exported_policy(text)) {
    player.exported_ = std::make_shared<Exported>(find_exported_policy(text, options.trust), options.device);
    const ExportedPolicy& found = player.exported_->found();
    if (found.manifest) player.origin_ = std::make_shared<Origin>(origin_of(*found.manifest, found.file.string()));
    return player;
  }
  player = of_checkpoint(find_best_checkpoint(text), options);
  player.rename(text);
  return player;
}

Player Player::load_mixed(const std::string& text, const PlayerOptions& options) {
  const MixedTeam team = read_mixed_team(text);
  Player player;
  player.name_ = text;
  for (const std::string& policy : team.policies) {
    try {
      if (names_mixed_team(policy) && fs::exists(policy))
        throw InputError(cat(policy, " is a mixed team itself; list those who play in it"));
      player.mixed_.push_back(load(policy, options));
    } catch (const InputError& e) {
      throw InputError(cat(team.at, ": policies[", player.mixed_.size(), "]: ", e.what()));
    }
  }
  if (!player.can_play(0) && !player.can_play(1)) {
    std::string lacks;
    for (const Player& member : player.mixed_)
      for (int side = 0; side < kNTeams; ++side)
        if (!member.can_play(side)) lacks += cat(lacks.empty() ? "" : ", ", member.name(), " none of team ", side);
    throw InputError(cat(team.at, ": policies: there is no team that all can play: ", lacks));
  }
  return player;
}

Player Player::of_checkpoint(const FoundCheckpoint& found, const PlayerOptions& options) {
  const Checkpoint& checkpoint = found.checkpoint;
  LoadedPolicies loaded =
      load_policies(checkpoint.config_yaml, checkpoint.scenario_yaml, checkpoint.arrays, options.device);
  auto origin = std::make_shared<Origin>();
  origin->file = found.file.string();
  origin->scenario_name = checkpoint.scenario_name;
  origin->updates = checkpoint.updates;
  origin->agent_steps = checkpoint.agent_steps;
  origin->seconds = checkpoint.cursor.seconds;
  origin->run = std::move(loaded.run);
  origin->run.spec.name = checkpoint.scenario_name;
  for (const std::string& line : found.damaged) origin->warnings.push_back(cat(line, "; ", origin->file, " is taken"));
  Player player;
  player.name_ = origin->file;
  player.greedy_ = options.greedy;
  for (int team = 0; team < kNTeams; ++team) {
    if (loaded.actor[team])
      player.values_[team] =
          ValueFunction::load(origin->run, team, checkpoint.arrays, *loaded.actor[team], options.device);
    player.policy_[team] = std::move(loaded.actor[team]);
  }
  player.origin_ = std::move(origin);
  return player;
}

std::vector<const Player*> Player::members() const {
  std::vector<const Player*> all;
  for (const Player& member : mixed_) all.push_back(&member);
  if (all.empty()) all.push_back(this);
  return all;
}

bool Player::can_play(int side) const {
  if (is_mixed())
    return std::all_of(mixed_.begin(), mixed_.end(), [side](const Player& m) { return m.can_play(side); });
  return script_ || exported_ || policy_[side];
}

SimSpec Player::seen_by(const SimSpec& spec) const {
  SimSpec seen = spec;
  if (origin_)
    seen.params.egocentric_view =
        spec.params.egocentric_view && origin_->run.spec.params.egocentric_view && !computes_view();
  return seen;
}

bool Player::computes_view() const {
  return exported_ && exported_->found().manifest && exported_->found().manifest->shape.view;
}

bool Player::reads_image() const {
  if (exported_) return exported_->reads_image();
  return origin_ && algorithm_of(origin_->run.config).policy(origin_->run.config).actor.reads_image();
}

void Player::check_plays(const SimSpec& spec, const Scenario* scenario) const {
  for (const Player& member : mixed_) member.check_plays(spec, scenario);
  if (!origin_) return;
  const PolicyInterface policy =
      exported_ ? interface_of(*exported_->found().manifest) : interface_of(origin_->run.spec, reads_image());
  const SimSpec seen = seen_by(spec);
  std::string reasons;
  if (scenario) {
    SimSpec trained = origin_->run.spec;
    if (computes_view()) trained.params.egocentric_view = false;
    for (const auto& [key, there, here] :
         shape_changes({origin_->run.scenario, trained}, {*scenario, seen}, reads_image()))
      reasons += cat(reasons.empty() ? "; what differs: " : "; ", key, ": ", there, " there, ", here, " here");
  }
  check_fits(policy, seen, name_, reasons);
}

std::unique_ptr<TeamController> Player::controller(int side, const SimSpec& spec) {
  if (is_mixed()) {
    std::vector<std::shared_ptr<TeamController>> all;
    for (Player& member : mixed_) all.push_back(member.controller(side, spec));
    try {
      return mixed_controller(std::move(all));
    } catch (const InputError& e) {
      throw InputError(cat(name_, ": ", e.what()));
    }
  }
  if (script_) return script_controller(*script_);
  if (!exported_) return checkpoint_controller(side, spec);
  const ReadPolicy& read = exported_->policy_for(computes_view() ? spec : seen_by(spec));
  return policy_controller(*read.policy, greedy_ || read.greedy);
}

Mind Player::mind(int side, const SimSpec& spec) const {
  if (exported_) return {exported_->last_read().policy.get(), nullptr, greedy_ || exported_->last_read().greedy};
  const ValueFunction* values = values_[side].get();
  if (values && values->needs_state() && origin_->run.spec.state_size() != spec.state_size()) values = nullptr;
  return {policy_[side].get(), values, policy_[side] && (greedy_ || acts_greedily(origin_->run.config))};
}

std::unique_ptr<TeamController> Player::checkpoint_controller(int side, const SimSpec& spec) const {
  if (!policy_[side])
    throw InputError(cat(name_, " has no policy for team ", side, ", which did not learn in training; it plays side ",
                         1 - side, ", as who is named ", side == 0 ? "second" : "first", " does"));
  check_plays(spec);
  return policy_controller(*policy_[side], greedy_ || acts_greedily(origin_->run.config));
}

}  // namespace giga
