// gigastep bench: figures with spread, and a checksum that shows the work.
#include <gtest/gtest.h>

#include "program.hpp"

namespace giga::test {
namespace {

Document bench(const Workplace& here, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "bench");
  for (const char* more : {"--device", "cpu", "--repeats", "2", "--json", "-"}) arguments.emplace_back(more);
  const Outcome outcome = here.run(arguments);
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  return parse_yaml_text(outcome.out, "json");
}

void expect_sound(const Document& json, const std::string& result) {
  const auto n = [&](const char* key) { return number_at(json, {"results", result, key}); };
  EXPECT_GT(n("agent_steps_per_second"), 0);
  EXPECT_LE(n("min"), n("agent_steps_per_second"));
  EXPECT_GE(n("max"), n("agent_steps_per_second"));
  EXPECT_EQ(n("repeats"), 2);
  EXPECT_GT(n("memory_bytes"), 0);
  EXPECT_GT(number_at(json, {"results", result, "checksum", "episodes_ended"}), 0);
}

TEST(Bench, Simulation) {
  const Workplace here;
  const Document json = bench(here, {"sim", "--scenario", "identical_2_vs_2", "--worlds", "16,33", "--steps", "150"});
  EXPECT_EQ(at(json, {"kind"}).text, "sim");
  EXPECT_EQ(at(json, {"scenario"}).text, "identical_2_vs_2");
  EXPECT_EQ(at(json, {"hardware", "device"}).text, "cpu");
  ASSERT_EQ(at(json, {"results"}).items.size(), 2u);
  for (const std::string result : {"0", "1"}) {
    expect_sound(json, result);
    EXPECT_EQ(number_at(json, {"results", result, "steps"}), 150);
    EXPECT_EQ(number_at(json, {"results", result, "checksum", "steps"}), 450);  // one warm-up, two repeats
    EXPECT_GT(number_at(json, {"results", result, "checksum", "worlds_reset"}), 0);
  }
}

TEST(Bench, SameSeedSameChecksum) {
  const Workplace here;
  const auto sum = [&](const std::string& seed) {
    const Document json = bench(here, {"sim", "--worlds", "8", "--steps", "40", "--seed", seed});
    return at(json, {"results", "0", "checksum", "last_observation_sum"}).text;
  };
  const std::string first = sum("1");
  EXPECT_EQ(sum("1"), first);
  EXPECT_NE(sum("2"), first);
}

TEST(Bench, ClosedLoop) {
  const Workplace here;
  const Document json = bench(
      here, {"closed-loop", "--scenario", "identical_2_vs_2", "--worlds", "16", "--steps", "150", "--hidden", "8,8"});
  EXPECT_EQ(at(json, {"kind"}).text, "closed-loop");
  expect_sound(json, "0");
}

TEST(Bench, Training) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Document json = bench(here, {"train", "--config", "tiny.yaml", "--steps", "2", "--worlds", "32"});
  EXPECT_EQ(at(json, {"scenario"}).text, "identical_2_vs_2_void");
  EXPECT_EQ(number_at(json, {"results", "0", "worlds"}), 32);
  expect_sound(json, "0");
  EXPECT_EQ(number_at(json, {"results", "0", "checksum", "updates"}), 6);
}

TEST(Bench, TableForPeople) {
  const Workplace here;
  const Outcome outcome =
      here.run({"bench", "sim", "--worlds", "8", "--steps", "60", "--device", "cpu", "--repeats", "1"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"worlds", "median", "episodes_ended"}));
}

}  // namespace
}  // namespace giga::test
