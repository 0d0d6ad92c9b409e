// A run whose actors see images alone, through the commands: the plan, training, resuming, eval, rate, record, exports,
// exploit, and what is refused.
#include <gtest/gtest.h>

#include "program.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

// Two updates of 16 worlds x 8 steps x 4 agents.
constexpr const char* kPixels = R"(scenario: identical_2_vs_2_rgb
device: cpu
environment: {max_episode_length: 40, observation: {resolution: 12}}
train: {n_worlds: 16, total_agent_steps: 1024, n_threads: 1}
mappo:
  horizon: 8
  n_minibatches: 2
  n_epochs: 1
  actor: {encoder: impala, impala_width: 2, hidden: [8], memory: gru, memory_size: 4}
  critic: {kind: state, hidden: [8]}
eval: {episodes: 8, every_updates: 1, opponents: [random]}
checkpoint: {every_updates: 1, keep: 3}
)";

Outcome train(const Workplace& here, const std::string& run, const std::vector<std::string>& settings = {}) {
  std::vector<std::string> arguments = {"train", "pixels.yaml", "--run-dir", run, "--quiet"};
  for (const std::string& setting : settings) arguments.insert(arguments.end(), {"--set", setting});
  return here.run(arguments);
}

TEST(Pixels, ARunGoesThroughTheCommands) {
  const Workplace here;
  here.write("pixels.yaml", kPixels);
  // 16 worlds x 8 steps: 4 images of 12 x 12 x 3 = 432 bytes in each state, of 34 words.
  const Outcome plan = here.run({"train", "pixels.yaml", "--plan"});
  ASSERT_EQ(plan.code, 0) << plan.err;
  EXPECT_TRUE(contains(plan.out, {"the images of an update would take 216 KiB; they are drawn again from 17.0 KiB"}));

  ASSERT_EQ(train(here, "whole").code, 0);
  ASSERT_EQ(train(here, "parts", {"train.stop_at_agent_steps=512"}).code, 124);
  const Outcome resumed = here.run({"resume", "parts", "--quiet", "--set", "train.stop_at_agent_steps=none"});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(state_hash(here, "parts"), state_hash(here, "whole"));
  EXPECT_EQ(metrics_difference(timeless_metrics(here, "parts"), timeless_metrics(here, "whole")), "");

  // Against policies that read numbers, agents are given both.
  const Outcome numbers = train(here, "numbers",
                                {"scenario=identical_2_vs_2", "environment.observation.type=vector",
                                 "environment.observation.resolution=84", "mappo.actor.encoder=mlp"});
  ASSERT_EQ(numbers.code, 0) << numbers.err;
  const auto games = [&here](const std::string& player, const std::string& other) {
    const Outcome outcome = here.run({"eval", player, "--vs", other, "--episodes", "16", "--trust", "--json", "-"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome.code == 0 ? print_node(at(parse_yaml_text(outcome.out, player), {"sides"}).items.at(0)) : "";
  };  // as team 0
  games("numbers", "whole");
  games("whole", "numbers");
  // Whole games, with what is remembered: an exported policy plays as its run does.
  const std::string expected = games("whole", "pursuer");
  for (const char* format : {"safetensors", "torchscript", "onnx"}) {
    const Outcome outcome = here.run({"export", "whole", "--team", "0", "--format", format, "--out", format});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    if (format == std::string("onnx")) continue;  // which is written, not read
    EXPECT_EQ(games(format, "pursuer"), expected) << format;
  }

  const Outcome rated =
      here.run({"rate", "whole", "numbers", "--scripted", "random", "--episodes", "8", "--out", "rated"});
  EXPECT_EQ(rated.code, 0) << rated.err;
  const Outcome recorded = here.run({"record", "whole", "--vs", "pursuer", "--episodes", "2", "--out", "game"});
  ASSERT_EQ(recorded.code, 0) << recorded.err;
  EXPECT_EQ(here.run({"record", "--verify", "game.replay"}).code, 0);
  const Outcome exploited = here.run({"exploit", "whole", "--agent-steps", "512", "--episodes", "8", "--quiet"});
  EXPECT_EQ(exploited.code, 0) << exploited.err;

  const Outcome other_size =
      here.run({"eval", "whole", "--vs", "random", "--set", "environment.observation.resolution=20"});
  EXPECT_EQ(other_size.code, 2);
  EXPECT_TRUE(contains(other_size.err,
                       {"; what differs: observation.resolution: 12 there, 20 here; an agent observes images of "
                        "12 x 12 pixels",
                        " there, images of 20 x 20 pixels"}));
  const Outcome without = here.run({"eval", "whole", "--vs", "random", "--set", "environment.observation.type=vector",
                                    "--set", "environment.observation.resolution=84"});
  EXPECT_EQ(without.code, 2);
  EXPECT_TRUE(contains(without.err, {" there, no images here"}));
}

}  // namespace
}  // namespace giga::test
