// The rules of resuming: one table of what may change, one of why the rest may not.
#include "learn/resume_config.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>

#include "core/error.hpp"

namespace giga {
namespace {

struct Rule {
  std::string_view key;  // itself, or a prefix that ends in a dot
  std::string_view text;
};

/// What may change.
constexpr std::array kMayChange = {
    Rule{"train.total_agent_steps", "where the run ends; schedules stretch to the new end"},
    Rule{"train.max_wall_time", "when it stops and saves"},
    Rule{"train.n_threads", "CPU threads; sums may be rounded in another order"},
    Rule{"device", "where it runs; another kind of device rounds in another way"},
    Rule{"eval.every_updates", "how often it is evaluated"},
    Rule{"eval.episodes", "and how thoroughly"},
    Rule{"checkpoint.every_updates", "how often it is saved"},
    Rule{"checkpoint.keep", "how many are kept"},
    Rule{"checkpoint.keep_best", "and whether the best one is"},
    Rule{"mappo.learning_rate", "from here on, as all below"},
    Rule{"mappo.critic_learning_rate", ""},
    Rule{"mappo.schedule", ""},
    Rule{"mappo.final_learning_rate_factor", ""},
    Rule{"mappo.clip_coef", ""},
    Rule{"mappo.entropy_coef", ""},
    Rule{"mappo.max_grad_norm", ""},
    Rule{"mappo.target_kl", ""},
    Rule{"mappo.n_epochs", ""},
    Rule{"population.generations", "where the run ends"},
    Rule{"population.shaping.", "from here on, as all below"},
    Rule{"population.objective", ""},
    Rule{"population.max_steps", ""},
    Rule{"population.turns", ""},
    Rule{"population.generations_per_turn", ""},
    Rule{"openai_es.", ""},
    Rule{"snes.", ""},
    Rule{"des.", ""},
    Rule{"opponents.pool_share", ""},
    Rule{"opponents.pool_every_updates", ""},
    Rule{"opponents.pool_draw", ""},
    Rule{"opponents.pool_hardness", ""},
    Rule{"opponents.scripted", ""},
    Rule{"opponents.scripted_share", ""},
};

/// Why others may not.
constexpr std::array kReasons = {
    Rule{"scenario", "the policies and the saved worlds belong to their scenario"},
    Rule{"environment", "the policies and the saved worlds belong to their scenario"},
    Rule{"rules", "the policies and the saved worlds belong to their scenario"},
    Rule{"seed", "the draws of the rest of the run would no longer be those of one run"},
    Rule{"train.algorithm", "what one algorithm has saved means nothing to another"},
    Rule{"train.n_worlds", "the checkpoint holds the state of so many worlds"},
    Rule{"train.opponent", "who learns is decided at the start"},
    Rule{"train.learning_team", "who learns is decided at the start"},
    Rule{"population.actor.", "the saved parameters fit their networks only"},
    Rule{"openai_es.optimizer", "the checkpoint holds the moments of this optimizer"},
    Rule{"population.greedy", "the policies have been learned for the one or the other"},
    Rule{"population.", "the draws of the rest of the run would no longer be those of one run"},
    Rule{"opponents.pool_size", "the checkpoint holds a pool of this size"},
    Rule{"mappo.horizon", "the count of agent-steps done rests on it"},
    Rule{"mappo.actor.", "the saved parameters fit their networks only"},
    Rule{"mappo.critic.", "the saved parameters fit their networks only"},
    Rule{"mappo.value_norm", "the saved values are in the units of their normaliser"},
    Rule{"mappo.obs_norm", "the saved policies expect their observations so"},
    Rule{"eval.opponents", "metrics.csv has columns for these opponents"},
};

/// The longest rule that fits.
template <size_t N>
const Rule* find_rule(const std::array<Rule, N>& rules, std::string_view key) {
  const Rule* longest = nullptr;
  for (const Rule& rule : rules) {
    const bool fits = key == rule.key || (rule.key.ends_with('.') && key.starts_with(rule.key));
    if (fits && (!longest || rule.key.size() > longest->key.size())) longest = &rule;
  }
  return longest;
}

/// Why this setting may not change; none = it may. Where several rules fit, the longest decides.
std::optional<std::string_view> reason_against(std::string_view key) {
  const Rule* allowed = find_rule(kMayChange, key);
  const Rule* reason = find_rule(kReasons, key);
  if (allowed && (!reason || reason->key.size() <= allowed->key.size())) return std::nullopt;
  return reason ? reason->text : "what has been learned so far rests on it";
}

std::string keys_that_may_change() {
  std::string text;
  for (const Rule& rule : kMayChange) text += (text.empty() ? "" : ", ") + std::string(rule.key);
  return text;
}

/// Notes what differs, and what of it may not.
std::vector<std::string> compare(RunConfig& before, RunConfig& after, Errors& errors) {
  const std::vector<FieldInfo> old_fields = list_fields(fields_of(before)), new_fields = list_fields(fields_of(after));
  GIGA_CHECK(old_fields.size() == new_fields.size(), "field lists of one type differ");
  std::vector<std::string> changes;
  for (size_t k = 0; k < old_fields.size(); ++k) {
    const FieldInfo &from = old_fields[k], &to = new_fields[k];
    if (from.default_value == to.default_value) continue;
    changes.push_back(cat(from.path, ": ", from.default_value, " -> ", to.default_value));
    const std::optional<std::string_view> reason = reason_against(from.path);
    if (!reason) continue;
    errors.add({std::make_shared<const std::string>("--set " + from.path), 0, 0},
               cat(to.default_value, " instead of ", from.default_value,
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
  resumed.changes = compare(before, after, errors);
  if (!errors.empty()) throw InputError(cat(errors.text(), "\nwhat may change: ", keys_that_may_change()));
  resumed.run = load_run_config_text(print_yaml(after, false), scenario_yaml);
  return resumed;
}

std::string resumable_settings() {
  std::string text;
  for (const Rule& rule : kMayChange) {
    text += "  " + std::string(rule.key);
    if (!rule.text.empty())
      text += std::string(34 - std::min<size_t>(rule.key.size(), 33), ' ') + std::string(rule.text);
    text += '\n';
  }
  return text;
}

}  // namespace giga
