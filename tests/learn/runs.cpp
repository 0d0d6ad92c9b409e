#include "runs.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace giga::test {

LoadedRun small_run(const std::string& keys, const std::string& scenario_keys) {
  const std::string scenario =
      "limit_x: 6\nlimit_y: 6\nmax_episode_length: 40\nmaps: empty\n"
      "team_0: [{type: default, count: 2}]\nteam_1: [{type: default, count: 2}]\n" +
      scenario_keys;
  const std::string config =
      "seed: 3\n"
      "train: {n_worlds: 24, total_agent_steps: 100000, n_threads: 2, precision: fp32" +
      (keys.starts_with("train.") ? ", " + keys.substr(6, keys.find('\n') - 6) : std::string()) +
      "}\n"
      "mappo:\n"
      "  horizon: 8\n  n_epochs: 2\n  n_minibatches: 4\n"
      "  actor: {hidden: [16, 16]}\n" +
      (keys.starts_with("train.") ? (keys.find('\n') == std::string::npos ? "" : keys.substr(keys.find('\n') + 1))
                                  : keys) +
      (keys.find("critic:") == std::string::npos ? "\n  critic: {hidden: [16, 16]}\n" : "\n");
  return load_run_config_text(config, scenario);
}

std::unique_ptr<Learner> learner_of(const LoadedRun& run) { return make_learner(run, Device{}); }

double metric(const Metrics& metrics, const std::string& name) {
  for (const auto& [key, value] : metrics)
    if (key == name) return value;
  ADD_FAILURE() << "no metric " << name;
  return std::nan("");
}

NamedArrays saved(const Learner& learner) {
  NamedArrays arrays;
  learner.save(arrays);
  return arrays;
}

std::string difference(const NamedArrays& a, const NamedArrays& b) {
  if (a.size() != b.size()) return cat(a.size(), " and ", b.size(), " arrays");
  std::string names;
  for (size_t k = 0; k < a.size(); ++k)
    if (a[k].name != b[k].name || a[k].type != b[k].type || a[k].shape != b[k].shape || a[k].bytes != b[k].bytes)
      names += (names.empty() ? "" : ", ") + a[k].name;
  return names;
}

void expect_finite(const Metrics& metrics, int team) {
  for (const char* name :
       {"policy_loss", "value_loss", "entropy", "approx_kl", "clip_fraction", "explained_variance", "actor_grad_norm",
        "critic_grad_norm", "first_ratio_error", "information", "living_share", "skipped_share"})
    EXPECT_TRUE(std::isfinite(metric(metrics, cat(name, "_", team)))) << name << " of team " << team;
}

void expect_finite(const NamedArrays& arrays) {
  for (const NamedArray& a : arrays) {
    if (a.type != ArrayType::f32) continue;
    for (const float x : array_values<float>(a))
      if (!std::isfinite(x)) {
        ADD_FAILURE() << "array " << a.name << " holds " << x;
        break;
      }
  }
}

}  // namespace giga::test
