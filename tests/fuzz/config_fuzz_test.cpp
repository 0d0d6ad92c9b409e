// Mutated configs, scenarios, maps and agent types: each is read, and then prints and reads back to the same, or is
// refused with an InputError.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "core/error.hpp"
#include "learn/run_config.hpp"
#include "mutations.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {
namespace fs = std::filesystem;

DataDirs source_data() { return {source_path()}; }

std::string file_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// The YAML files directly in a folder, in the same order everywhere.
std::vector<std::string> texts_in(const std::string& folder) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(source_path(folder)))
    if (entry.path().extension() == ".yaml" && entry.path().filename() != "agent_types.yaml")
      files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<std::string> texts;
  for (const fs::path& file : files) texts.push_back(file_text(file));
  return texts;
}

std::string indented(const std::string& text) {
  std::string result = "    ";
  for (const char c : text) result += c == '\n' ? "\n    " : std::string(1, c);
  return result;
}

void read_scenario(const std::string& text) {
  const Scenario scenario = parse_scenario(text, "fuzz", source_data());
  const std::string printed = print_scenario(scenario);
  ASSERT_EQ(print_scenario(parse_scenario(printed, "fuzz", {})), printed) << text;
  compile(scenario);
}

/// Input of a number: one of the texts with a few changes.
std::string mutation(const std::vector<std::string>& seeds, int64_t number) {
  Mutator mutator(static_cast<uint64_t>(number));
  const std::string& seed = mutator.one_of(seeds);
  return mutator.text(seed, seeds);
}

TEST(ConfigFuzz, Scenarios) {
  std::vector<std::string> seeds = texts_in("scenarios");
  seeds.push_back(print_scenario(load_scenario("special_5_vs_1", source_data())));
  seeds.push_back(print_scenario(load_scenario("waypoint_5_vs_3_fobs", source_data())));
  ASSERT_GT(seeds.size(), 20u);
  const FuzzCount count = fuzz(
      "scenarios", 4000 / thinned(4), [&](int64_t k) { return mutation(seeds, k); }, read_scenario);
  EXPECT_GT(count.accepted, 50 / thinned(4));
  EXPECT_GT(count.refused, 100 / thinned(4));
}

// As part of a scenario, so that they are compiled too.
TEST(ConfigFuzz, MapsAndAgentTypes) {
  const std::vector<std::string> maps = texts_in("scenarios/maps");
  const std::string types = file_text(source_path("scenarios/agent_types.yaml"));
  ASSERT_EQ(maps.size(), 8u);
  const auto make = [&](int64_t k) {
    if (k % 3 == 0) return "base: identical_1_vs_1\nteam_0: [{type: super}]\n" + mutation({types}, k);
    return "base: identical_1_vs_1\nmaps: m\nmap_definitions:\n  m:\n" + indented(mutation(maps, k));
  };
  const FuzzCount count = fuzz("maps and agent types", 3000 / thinned(4), make, read_scenario);
  EXPECT_GT(count.accepted, 50 / thinned(4));
  EXPECT_GT(count.refused, 100 / thinned(4));
}

TEST(ConfigFuzz, RunConfigs) {
  std::vector<std::string> seeds = texts_in("configs");
  ASSERT_EQ(seeds.size(), 20u);
  seeds.push_back(print_yaml(RunConfig(), true));
  seeds.emplace_back(
      "scenario: special_5_vs_5_void\nrules: original\nenvironment: {limit_x: 12, team_1: [{type: super, count: 2}], "
      "maps: [empty, four_rooms], rewards: {damage: 5}}\ntrain: {n_worlds: 64, opponent: circle}\n");
  const std::string file = testing::TempDir() + cat("gigastep_fuzz_run_", getpid(), ".yaml");
  const auto read = [&file](const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
    const LoadedRun run = load_run_config(file, {});
    const std::string printed = print_yaml(run.config, true);
    // The environment may name files beside the config, so the resolved config is read at the same place.
    std::ofstream(file, std::ios::binary) << printed;
    ASSERT_EQ(print_yaml(load_run_config(file, {}).config, true), printed) << text;
  };
  const FuzzCount count = fuzz(
      "run configs", 1500 / thinned(4), [&](int64_t k) { return mutation(seeds, k); }, read);
  std::remove(file.c_str());
  EXPECT_GT(count.accepted, 50 / thinned(4));
  EXPECT_GT(count.refused, 100 / thinned(4));
}

TEST(ConfigFuzz, Assignments) {
  const std::vector<std::string> seeds = {"seed=3",
                                          "mappo.actor.hidden=[32, 32]",
                                          "train.total_agent_steps=3e8",
                                          "environment.rewards={damage: 50, detection: 2}",
                                          "environment.team_0=[{type: hider, count: 2}]",
                                          "eval.opponents=[random, circle]",
                                          "rules=none"};
  const std::string file = testing::TempDir() + cat("gigastep_fuzz_set_", getpid(), ".yaml");
  std::ofstream(file) << "scenario: identical_2_vs_2\n";
  const FuzzCount count = fuzz(
      "assignments", 3000 / thinned(4), [&](int64_t k) { return mutation(seeds, k); },
      [&file](const std::string& text) {
        load_run_config(file, {text, "seed=1"});
      });
  std::remove(file.c_str());
  EXPECT_GT(count.accepted, 50 / thinned(4));
  EXPECT_GT(count.refused, 100 / thinned(4));
}

}  // namespace
}  // namespace giga::test
