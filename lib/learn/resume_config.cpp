// The rules of resuming: what may change, and why the rest may not. Those of an algorithm stand with its settings.
#include "learn/resume_config.hpp"

#include <algorithm>
#include <optional>
#include <span>
#include <string_view>
#include <tuple>

#include "core/error.hpp"
#include "learn/mixed_team.hpp"
#include "learn/opponents/world_shares.hpp"

namespace giga {
namespace {

constexpr ResumeRule kMayChange[] = {
    {"train.total_agent_steps", "where the run ends; schedules stretch to the new end"},
    {"train.max_wall_time", "when it stops and saves"},
    {"train.stop_at_agent_steps", "where it stops and saves"},
    {"train.opponent", "where the policy lies now; it must be the same one"},
    {"train.n_threads", "CPU threads; sums may be rounded in another order"},
    {"train.compile_step", "how worlds are stepped; the numbers are the same"},
    {"train.pairs", "how pairs of agents are found; the numbers are the same"},
    {"device", "where it runs; another kind of device rounds in another way"},
    {"eval.every_updates", "how often it is evaluated"},
    {"eval.episodes", "and how thoroughly"},
    {"eval.record", "and how many games it keeps"},
    {"checkpoint.every_updates", "how often it is saved"},
    {"checkpoint.keep", "how many are kept"},
    {"checkpoint.keep_best", "and whether the best one is"},
    {"opponents.pool_share", "from here on, as all below"},
    {"opponents.pool_every_updates", ""},
    {"opponents.pool_draw", ""},
    {"opponents.pool_hardness", ""},
    {"opponents.policies", ""},
    {"opponents.scripted", ""},
    {"opponents.scripted_share", ""},
};
constexpr ResumeRule kMayNot[] = {
    {"scenario", "the policies and the saved worlds belong to their scenario"},
    {"environment", "the policies and the saved worlds belong to their scenario"},
    {"rules", "the policies and the saved worlds belong to their scenario"},
    {"seed", "the draws of the rest of the run would no longer be those of one run"},
    {"train.algorithm", "what one algorithm has saved means nothing to another"},
    {"train.n_worlds", "the checkpoint holds the state of so many worlds"},
    {"train.learning_team", "who learns is decided at the start"},
    {"opponents.pool_size", "the checkpoint holds a pool of this size"},
    {"opponents.pool_promotion", "the checkpoint holds the games on which it goes"},
    {"eval.opponents", "metrics.csv has columns for these opponents"},
};

/// Those of every run, and those of the algorithms.
std::vector<ResumeRules> all_rules() {
  std::vector<ResumeRules> all = Algorithms::Settings::resume_rules();
  all.insert(all.begin(), ResumeRules{kMayChange, kMayNot});
  return all;
}

/// The longest rule that fits.
const ResumeRule* find_rule(std::span<const ResumeRule> ResumeRules::*kind, std::string_view key) {
  const ResumeRule* longest = nullptr;
  for (const ResumeRules& rules : all_rules())
    for (const ResumeRule& rule : rules.*kind) {
      const bool fits = key == rule.key || (rule.key.ends_with('.') && key.starts_with(rule.key));
      if (fits && (!longest || rule.key.size() > longest->key.size())) longest = &rule;
    }
  return longest;
}

/// Why this setting may not change; none = it may. Where several rules fit, the longest decides.
std::optional<std::string_view> reason_against(std::string_view key) {
  const ResumeRule* allowed = find_rule(&ResumeRules::may_change, key);
  const ResumeRule* reason = find_rule(&ResumeRules::may_not, key);
  if (allowed && (!reason || reason->key.size() <= allowed->key.size())) return std::nullopt;
  return reason ? reason->text : "what has been learned so far rests on it";
}

/// "snes.*" of all keys of that group.
std::string for_people(std::string_view rule_key) { return cat(rule_key, rule_key.ends_with('.') ? "*" : ""); }

std::string keys_that_may_change() {
  std::string text;
  for (const ResumeRules& rules : all_rules())
    for (const ResumeRule& rule : rules.may_change) text += (text.empty() ? "" : ", ") + for_people(rule.key);
  return text;
}

/// Where the user has given a setting.
Position place_of(const std::string& key) { return {std::make_shared<const std::string>("--set " + key), 0, 0}; }

/// Notes what differs, and what of it may not.
std::vector<std::string> compare(RunConfig& before, RunConfig& after, Errors& errors) {
  const std::vector<FieldInfo> old_fields = list_fields(fields_of(before)), new_fields = list_fields(fields_of(after));
  GIGA_CHECK(old_fields.size() == new_fields.size(), "field lists of one type differ");
  std::vector<std::string> changes;
  for (size_t k = 0; k < old_fields.size(); ++k) {
    const FieldInfo &from = old_fields[k], &to = new_fields[k];
    if (from.default_value == to.default_value) continue;
    changes.push_back(cat(from.path, ": ", from.default_value, " -> ", to.default_value));
    std::optional<std::string_view> reason = reason_against(from.path);
    // That it is the same policy is checked where it is loaded.
    if (from.path == "train.opponent" && !(before.train.opponent.is_path() && after.train.opponent.is_path()))
      reason = "who learns is decided at the start, and against whom";
    // The setting is only where the weight began.
    if (from.path == "mappo.entropy_coef" && before.mappo.entropy_target)
      reason = "the weight of the bonus follows mappo.entropy_target, from what it is now";
    if (!reason) continue;
    errors.add(place_of(from.path), cat(to.default_value, " instead of ", from.default_value,
                                        ": this may not change when a run goes on: ", *reason));
  }
  return changes;
}

}  // namespace

ResumedRun resume_config(const std::string& config_yaml, const std::string& scenario_yaml,
                         const std::vector<std::string>& overrides) {
  Errors errors;
  Document document = parse_yaml_text(config_yaml, "config of the checkpoint", errors);
  RunConfig before, after;
  read_fields(document.root, before, errors);
  errors.throw_if_any();
  for (const std::string& assignment : overrides) set_override(document, assignment, errors);
  read_fields(document.root, after, errors);
  errors.throw_if_any();

  ResumedRun resumed;
  const bool keeps_policies = after.opponents.policies == before.opponents.policies;
  if (!keeps_policies) find_policies(after, place_of("opponents.policies"), errors);
  if (after.train.opponent.name != before.train.opponent.name)
    find_opponent(after, {{"train.opponent", place_of("train.opponent")}}, errors);
  else if (after.mappo.shards != before.mappo.shards)  // the worlds of a shard are what a mixed team shares
    find_opponent(after, {{"train.opponent", place_of("mappo.shards")}}, errors);
  resumed.changes = compare(before, after, errors);
  if (!errors.empty()) throw InputError(cat(errors.text(), "\nwhat may change: ", keys_that_may_change()));
  resumed.run = load_run_config_text(print_yaml(after, false), scenario_yaml);
  resumed.run.policies_are_saved = keeps_policies;
  const auto worlds_of = [](const RunConfig& c) {
    return std::tuple{c.mappo.shards, c.opponents.pool_share, c.opponents.scripted_share, c.opponents.scripted};
  };
  // Members of a mixed team share out the worlds of each shard among them.
  const bool some = has_further_opponents(before.opponents) || has_further_opponents(after.opponents) ||
                    (after.train.opponent.is_path() && names_mixed_team(after.train.opponent.name));
  resumed.run.opponents_move = some && worlds_of(after) != worlds_of(before);
  resumed.run.other_scripts = after.opponents.scripted != before.opponents.scripted;
  return resumed;
}

std::string resumable_settings() {
  std::string text;
  for (const ResumeRules& rules : all_rules())
    for (const ResumeRule& rule : rules.may_change) {
      const std::string key = for_people(rule.key);
      text += "  " + key;
      if (!rule.text.empty()) text += std::string(34 - std::min<size_t>(key.size(), 33), ' ') + std::string(rule.text);
      text += '\n';
    }
  return text;
}

}  // namespace giga
