#include "runs.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <utility>

#include "io/checkpoint.hpp"

namespace giga::test {

namespace {

template <class T>
void change_each(NamedArray& array, T (*change)(T)) {
  for (size_t at = 0; at + sizeof(T) <= array.bytes.size(); at += sizeof(T)) {
    T value;
    std::memcpy(&value, &array.bytes[at], sizeof value);
    value = change(value);
    std::memcpy(&array.bytes[at], &value, sizeof value);
  }
}

}  // namespace

LoadedRun SmallRun::load() const {
  const auto with = [](const std::string& keys) { return keys.empty() ? "" : ", " + keys; };
  const bool evolves = train.find("algorithm") != std::string::npos;
  const std::string worlds = evolves ? "" : "n_worlds: 24, total_agent_steps: 100000, ";
  const std::string config = cat("seed: ", seed, "\ntrain: {", worlds, "n_threads: ", n_threads,
                                 ", compile_step: never, precision: ", precision, with(train),
                                 "}\nmappo: {horizon: 8, n_epochs: 2, n_minibatches: 4, actor: {", actor,
                                 "}, critic: {", critic, "}", with(mappo), "}\n", more);
  std::string text = scenario;
  for (const auto& [key, value] : {std::pair{"limit_x", "6"},
                                   {"limit_y", "6"},
                                   {"max_episode_length", "40"},
                                   {"maps", "empty"},
                                   {"team_0", "[{type: default, count: 2}]"},
                                   {"team_1", "[{type: default, count: 2}]"}})
    if (scenario.find(cat(key, ":")) == std::string::npos) text += cat(key, ": ", value, "\n");
  return load_run_config_text(config, text);
}

void save(const SmallRun& small, const std::string& file, int64_t updates) {
  const LoadedRun run = small.load();
  Checkpoint c;
  c.scenario_name = "small";
  c.config_yaml = print_yaml(run.config, true);
  c.scenario_yaml = print_scenario(run.scenario);
  c.updates = updates;
  c.arrays = saved(*small.learner());
  std::filesystem::create_directories(std::filesystem::path(file).parent_path());
  write_checkpoint(file, c);
}

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

std::string difference(const Metrics& a, const Metrics& b) {
  if (a.size() != b.size()) return cat(a.size(), " and ", b.size(), " figures");
  std::string names;
  for (size_t k = 0; k < a.size(); ++k)
    if (a[k].first != b[k].first || std::memcmp(&a[k].second, &b[k].second, sizeof(double)) != 0)
      names += cat(names.empty() ? "" : ", ", a[k].first, " ", a[k].second, " / ", b[k].second);
  return names;
}

void disturb(NamedArray& array) {
  switch (array.type) {
    case ArrayType::f32:
      return change_each<float>(array, [](float x) { return x + 0.25f; });
    case ArrayType::f64:
      return change_each<double>(array, [](double x) { return x + 0.25; });
    case ArrayType::i32:
      return change_each<int32_t>(array, [](int32_t x) { return x ^ 1; });
    case ArrayType::i64:
      return change_each<int64_t>(array, [](int64_t x) { return x + 1; });
    case ArrayType::u8:
      return change_each<uint8_t>(array, [](uint8_t x) { return static_cast<uint8_t>(x ^ 1); });
  }
}

void expect_finite(const Metrics& metrics, int team) {
  for (const char* name :
       {"policy_loss", "value_loss", "entropy", "approx_kl", "clip_fraction", "explained_variance", "actor_grad_norm",
        "critic_grad_norm", "first_ratio_error", "mutual_information", "living_share", "skipped_share"})
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
