#include "eval/contestant.hpp"

#include <filesystem>
#include <fstream>

#include "config/fields.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "eval/policies.hpp"
#include "eval/torchscript_policy.hpp"
#include "io/run_folder.hpp"
#include "policy/actor.hpp"
#include "sim/observe.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

/// Whether a file begins like a ZIP archive, which is what TorchScript modules are.
bool is_zip(const fs::path& path) {
  char head[4] = {};
  std::ifstream(path, std::ios::binary).read(head, sizeof head);
  return head[0] == 'P' && head[1] == 'K' && head[2] == 3 && head[3] == 4;
}

bool is_exported(const fs::path& path) {
  std::error_code code;
  if (fs::is_directory(path, code)) return fs::exists(path / "manifest.json", code);
  return path.extension() == ".safetensors" || path.extension() == ".onnx";
}

[[noreturn]] void fail_unknown(const std::string& text) {
  if (text.find_first_of("/\\.") != std::string::npos)
    throw InputError(cat("there is no checkpoint or run folder ", text));
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  throw InputError(cat("'", text, "' is neither a scripted team nor a file or folder", nearest_hint(text, names),
                       "; scripted teams: ", join(names)));
}

/// What an agent's observation is made of, for people.
std::string layout_of(const SimSpec& spec) {
  const SimParams& p = spec.params;
  return cat(spec.observation_size(), " numbers: ", p.n_neighbors, " agents, ",
             p.waypoints ? "a waypoint" : "no waypoint", ", ", p.n_boxes, " boxes of ", box_features(p));
}

bool same_layout(const SimSpec& a, const SimSpec& b) {
  const SimParams &p = a.params, &q = b.params;
  return p.n_neighbors == q.n_neighbors && p.waypoints == q.waypoints && p.n_boxes == q.n_boxes &&
         box_features(p) == box_features(q);
}

}  // namespace

std::optional<Scripted> find_script(const std::string& name) {
  const std::vector<std::string> names = FieldCodec<Scripted>::names();
  for (size_t k = 0; k < names.size(); ++k)
    if (name == names[k]) return static_cast<Scripted>(k);
  return std::nullopt;
}

Contestant Contestant::load(const std::string& text, const ContestantOptions& options) {
  Contestant c;
  c.name_ = text;
  c.greedy_ = options.greedy;
  c.script_ = find_script(text);
  if (c.script_) return c;
  std::error_code code;
  if (!fs::exists(text, code)) fail_unknown(text);
  // Exported policies: this is where reading them goes, filling policy_ for both teams.
  if (is_exported(text))
    throw InputError(cat(text, " is an exported policy, which this version cannot play: give the checkpoint it is of"));
  if (is_zip(text)) {
    if (!options.trust)
      throw InputError(cat(text,
                           " is a TorchScript module, which can run any code when it is opened; if you trust where "
                           "it comes from: --trust"));
    c.module_ = TorchScriptPolicy::load(text, options.device);
    return c;
  }
  c.load_checkpoint(text, options.device);
  return c;
}

void Contestant::load_checkpoint(const std::string& path, Device device) {
  const FoundCheckpoint found = find_best_checkpoint(path);
  const Checkpoint& checkpoint = found.checkpoint;
  LoadedPolicies loaded = load_policies(checkpoint.config_yaml, checkpoint.scenario_yaml, checkpoint.arrays, device);
  for (int team = 0; team < kNTeams; ++team) policy_[team] = std::move(loaded.actor[team]);
  auto origin = std::make_shared<Origin>();
  origin->file = found.file.string();
  origin->scenario_name = checkpoint.scenario_name;
  origin->updates = checkpoint.updates;
  origin->agent_steps = checkpoint.agent_steps;
  origin->run = std::move(loaded.run);
  origin->run.spec.name = checkpoint.scenario_name;
  for (const std::string& line : found.damaged) origin->warnings.push_back(cat(line, "; ", origin->file, " is taken"));
  origin_ = std::move(origin);
}

bool Contestant::can_play(int side) const { return script_ || module_ || policy_[side]; }

Player Contestant::player(int side, const SimSpec& spec) {
  if (script_) return {nullptr, *script_, false};
  if (module_) {
    module_->bind(spec);
    const bool only_means = spec.params.actions == ActionKind::continuous && !module_->has_log_std();
    return {module_.get(), Scripted::random, greedy_ || only_means};
  }
  check_fit(side, spec);
  return {policy_[side].get(), Scripted::random, greedy_ || acts_greedily(origin_->run.config)};
}

void Contestant::check_fit(int side, const SimSpec& spec) const {
  if (!policy_[side])
    throw InputError(cat(name_, " has no policy for team ", side, ", which was scripted while it trained"));
  const SimSpec& own = origin_->run.spec;
  const auto kind = [](ActionKind actions) { return actions == ActionKind::discrete ? "discrete" : "continuous"; };
  if (own.params.actions != spec.params.actions)
    throw InputError(cat(name_, " was trained in '", own.name, "' with ", kind(own.params.actions),
                         " actions; those of '", spec.name, "' are ", kind(spec.params.actions)));
  if (!same_layout(own, spec))
    throw InputError(cat(name_, " was trained in '", own.name, "', where an agent observes ", layout_of(own), "; in '",
                         spec.name, "' it observes ", layout_of(spec)));
}

}  // namespace giga
