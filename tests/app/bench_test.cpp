// gigastep bench: figures with spread, and a checksum that shows the work.
#include <gtest/gtest.h>

#include "program.hpp"

namespace giga::test {
namespace {

Document bench(const Workplace& here, std::vector<std::string> arguments, const std::string& device = "cpu") {
  arguments.insert(arguments.begin(), "bench");
  for (const std::string& more : {std::string("--device"), device, std::string("--repeats"), std::string("2"),
                                  std::string("--json"), std::string("-")})
    arguments.push_back(more);
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
  EXPECT_EQ(at(json, {"results", result, "arithmetic"}).text, "fp32");  // whatever was asked for: CPUs have no other
  EXPECT_EQ(at(json, {"results", result, "commit"}).text, at(json, {"versions", "commit"}).text);
}

/// Both parts of an update took time, together no more than all of it: a rate is agent-steps / seconds, so 1 / rate
/// adds up. The slowest repeat bounds the mean of all.
void expect_split(const Document& json, const std::string& result, double agent_steps_per_update) {
  double seconds_per_agent_step = 0;
  for (const char* part : {"rollout", "learning"}) {
    const double seconds = number_at(json, {"results", result, part, "seconds_per_update"});
    const double rate = number_at(json, {"results", result, part, "agent_steps_per_second"});
    EXPECT_GT(seconds, 0) << part;
    if (agent_steps_per_update > 0) {
      EXPECT_NEAR(seconds * rate, agent_steps_per_update, 1e-6 * agent_steps_per_update);
    }
    seconds_per_agent_step += 1 / rate;
  }
  EXPECT_LE(seconds_per_agent_step, 1.001 / number_at(json, {"results", result, "min"}));
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

// 2 vs 2: a row of 52 numbers, a reward and a byte written, an action of 4 bytes read; of the state 6 numbers, a byte,
// 4 counters, 2 words of bits and a quarter of the world's 5 words and a byte read and written: 208 + 4 + 1 + 4 + 2 (24
// + 1 + 4 + 8 + 5.25) = 301.5, printed as 302.
TEST(Bench, ComparesWithAnEarlierCall) {
  const Workplace here;
  const std::vector<std::string> sim = {"bench",     "sim", "--scenario", "identical_2_vs_2",
                                        "--worlds",  "16",  "--steps",    "20",
                                        "--repeats", "2",   "--device",   "cpu"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), sim.begin(), sim.end());
    return here.run(more);
  };
  ASSERT_EQ(with({"--json", "old.json"}).code, 0);
  const Outcome text = with({"--compare", "old.json"});
  EXPECT_TRUE(contains(text.out, {"at least 302 bytes an agent-step", " times the ", " by the quartiles)"}))
      << text.out;
  const Document json = parse_yaml_text(with({"--compare", "old.json", "--json", "-"}).out, "json");
  const double now = number_at(json, {"results", "0", "agent_steps_per_second"});
  const double then = number_at(json, {"results", "0", "compared", "agent_steps_per_second"});
  EXPECT_NEAR(number_at(json, {"results", "0", "compared", "ratio"}), now / then, 1e-6);
  EXPECT_EQ(number_at(json, {"results", "0", "bytes_per_agent_step"}), 301.5);

  const Outcome other = here.run({"bench", "closed-loop", "--compare", "old.json"});
  EXPECT_EQ(other.code, 2);
  EXPECT_TRUE(contains(other.err, {"old.json has results of bench \"sim\", not of closed-loop"})) << other.err;
  EXPECT_TRUE(contains(with({"--compare", "none.json"}).err, {"--compare: cannot read none.json"}));
  EXPECT_TRUE(contains(with({"--compare", "old.json", "--worlds", "8"}).err,
                       {"note: old.json has no result of 8 worlds to compare with"}));
  std::string elsewhere = here.read("old.json");
  elsewhere.replace(elsewhere.find("\"device\": \"cpu\""), 15, "\"device\": \"cuda:0\"");
  here.write("elsewhere.json", elsewhere);
  EXPECT_TRUE(contains(with({"--compare", "elsewhere.json"}).err,
                       {"--compare: elsewhere.json was measured on cuda:0, and this is cpu"}));
}

TEST(Bench, Images) {
  const Workplace here;
  const Document json = bench(here, {"sim", "--scenario", "identical_2_vs_2_rgb", "--worlds", "16", "--steps", "150"});
  expect_sound(json, "0");
  const auto check = [&](const char* key) { return number_at(json, {"results", "0", "checksum", key}); };
  EXPECT_EQ(check("images_written"), 3 * 150 * 16 * 4);  // one warm-up, two repeats; agents
  EXPECT_EQ(check("observations_written"), 0);           // images alone
  EXPECT_GT(check("some_last_images_sum"), 0);
  // As in ComparesWithAnEarlierCall, with an image of 84 * 84 * 3 = 21168 bytes in place of 208 of a row.
  EXPECT_EQ(number_at(json, {"results", "0", "bytes_per_agent_step"}), 301.5 - 208 + 21168);
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

TEST(Bench, ClosedLoopKnowsThePrecisions) {
  const Workplace here;
  for (const std::string precision : {"fp32", "tf32", "bf16"})
    expect_sound(bench(here, {"closed-loop", "--scenario", "identical_2_vs_2", "--worlds", "16", "--steps", "150",
                              "--hidden", "8", "--precision", precision}),
                 "0");
  const Outcome wrong = here.run({"bench", "closed-loop", "--precision", "fp64"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_TRUE(contains(wrong.err, {"--precision: 'fp64' is not one of: fp32, tf32, bf16"}));
  EXPECT_EQ(here.run({"bench", "closed-loop", "--precision", "fp16"}).code, 2);  // for populations alone
  EXPECT_TRUE(contains(here.run({"bench", "closed-loop", "--help"}).out, {"--precision fp32|tf32|bf16"}));
}

// Each row sets its own arithmetic and says it; the first row and the second play the same games. (Games in fp32 and
// TF32 need not differ: new networks are so small that rounding rarely changes a drawn action.)
TEST(BenchGpu, ClosedLoopComputesInThePrecisionOfEachRow) {
  const Workplace here;
  const Outcome probe =
      here.run({"bench", "sim", "--worlds", "8", "--steps", "2", "--repeats", "1", "--device", "cuda"});
  if (probe.code == 2 && contains(probe.err, {"0 GPUs found"})) GTEST_SKIP() << "no GPU";
  ASSERT_EQ(probe.code, 0) << probe.err;
  for (const std::string precision : {"fp32", "tf32", "bf16"}) {
    const Document json = bench(here,
                                {"closed-loop", "--scenario", "identical_2_vs_2", "--worlds", "64,64", "--steps", "150",
                                 "--hidden", "64,64", "--precision", precision},
                                "cuda");
    for (const std::string result : {"0", "1"}) EXPECT_EQ(at(json, {"results", result, "arithmetic"}).text, precision);
    EXPECT_EQ(at(json, {"results", "1", "checksum", "last_observation_sum"}).text,
              at(json, {"results", "0", "checksum", "last_observation_sum"}).text)
        << precision;
  }
}

TEST(Bench, Training) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Document json = bench(here, {"train", "--config", "tiny.yaml", "--steps", "2", "--worlds", "32"});
  EXPECT_EQ(at(json, {"scenario"}).text, "identical_2_vs_2_void");
  EXPECT_EQ(number_at(json, {"results", "0", "worlds"}), 32);
  expect_sound(json, "0");
  EXPECT_EQ(number_at(json, {"results", "0", "checksum", "updates"}), 6);
  expect_split(json, "0", 32 * 16 * 4);  // worlds x horizon x agents
}

// Both numbers of worlds are divided by loops of one arithmetic.
TEST(Bench, Evolution) {
  const Workplace here;
  const Document json = bench(here, {"es", "--scenario", "identical_2_vs_2_void", "--worlds", "16,32", "--steps", "1",
                                     "--set", "population.max_steps=20", "--set", "population.actor.hidden=[8]"});
  for (const std::string result : {"0", "1"}) {
    expect_sound(json, result);
    expect_split(json, result, 0);  // members' episodes differ in length: no update makes as many steps as another
    EXPECT_EQ(at(json, {"results", result, "closed_loop_arithmetic"}).text, "fp32");
    EXPECT_GT(number_at(json, {"results", result, "checksum", "share_of_closed_loop"}), 0);
  }
}

// What an agent-step of 2 vs 2 must move with its outputs is 301.5 bytes (ComparesWithAnEarlierCall): 52 numbers of a
// row, reward and alive are 208 + 4 + 1 of them.
TEST(Bench, NothingStored) {
  const Workplace here;
  const std::vector<std::string> sizes = {"sim", "--scenario", "identical_2_vs_2", "--worlds", "16", "--steps", "150"};
  std::vector<std::string> without = sizes;
  without.emplace_back("--nothing-stored");
  const Document all = bench(here, sizes), json = bench(here, without);
  EXPECT_EQ(number_at(json, {"results", "0", "bytes_per_agent_step"}), 301.5 - 213);
  const auto ended = [](const Document& result) {
    return number_at(result, {"results", "0", "checksum", "episodes_ended"});
  };
  EXPECT_GT(ended(all), 0);
  EXPECT_EQ(ended(json), ended(all)) << "the same games";
  EXPECT_EQ(json.root.find("results")->items[0].find("checksum")->find("observations_written"), nullptr);
}

TEST(Bench, TheDeviceIsNotSetOtherwise) {
  const Workplace here;
  const Outcome outcome = here.run({"bench", "train", "--config", "quickstart", "--set", "device=cpu"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(contains(outcome.err, {"--set device=cpu: --device says where"}));
}

TEST(Bench, TableForPeople) {
  const Workplace here;
  std::vector<std::string> arguments = {"bench", "sim",      "--worlds", "8",         "--steps",
                                        "60",    "--device", "cpu",      "--repeats", "1"};
  const Outcome outcome = here.run(arguments);
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"worlds", "median", "arithmetic", "fp32", "commit"}));
  EXPECT_EQ(outcome.out.find("last_observation_sum"), std::string::npos) << "nobody asked";
  arguments.emplace_back("--proof");
  EXPECT_TRUE(contains(here.run(arguments).out, {"episodes_ended", "last_observation_sum"}));
}

}  // namespace
}  // namespace giga::test
