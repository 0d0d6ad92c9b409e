// Plain networks against LibTorch's, and whole games of theirs.
#include "play/plain_network.hpp"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <algorithm>

#include "eval/record.hpp"
#include "play/plain_actor.hpp"
#include "play/session.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga::test {
namespace {

constexpr int64_t kRow = 48, kInputs = 45, kRows = 64;

at::Tensor random_rows() {
  at::Tensor rows = at::empty({kRows, kRow});
  DrawKey key(7, 0, 0);
  for (int64_t k = 0; k < rows.numel(); ++k)
    rows.data_ptr<float>()[k] =
        4 * key.uniform(Draw::init, static_cast<uint32_t>(k / kRow), static_cast<uint32_t>(k % kRow)) - 2;
  rows.narrow(1, kInputs, kRow - kInputs).zero_();  // as behind the last number of a row
  return rows;
}

/// The largest difference of a head, after the network went through bytes. The greatest number of each head is the
/// same.
float difference_of(Actor& actor) {
  at::NoGradGuard no_grad;
  if (actor.normalizes()) actor.normalizer().update(random_rows() * 3 + 1, at::ones({kRows}));
  const PlainNetwork network = read_network(network_bytes(plain_network_of(actor, kInputs, false)));
  EXPECT_EQ(static_cast<int64_t>(network.inputs()), kInputs);
  const at::Tensor rows = random_rows(), heads = actor.forward(rows).contiguous();
  const int outputs = actor.actions() == ActionKind::discrete ? kNDiscreteActions : kActionSize;
  float largest = 0;
  for (int64_t row = 0; row < kRows; ++row) {
    std::vector<float> head(static_cast<size_t>(outputs), NAN);
    network.forward(rows.const_data_ptr<float>() + row * kRow, head.data());
    const float* expected = heads.const_data_ptr<float>() + row * heads.size(1);
    for (int k = 0; k < outputs; ++k) {
      const float apart = std::fabs(head[static_cast<size_t>(k)] - expected[k]);
      largest = apart <= largest ? largest : apart;
    }
    EXPECT_EQ(std::max_element(head.begin(), head.end()) - head.begin(),
              std::max_element(expected, expected + outputs) - expected)
        << "row " << row;
  }
  return largest;
}

TEST(PlainNetwork, ComputesWhatLibTorchDoes) {
  for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu})
    for (const bool norm : {false, true})
      for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
        ActorConfig config;
        config.hidden = {64, 32};
        config.activation = activation;
        config.layer_norm = norm;
        config.output_gain = 1;
        // With a normaliser the network reads columns 8 to 39 alone, as one of the egocentric view does.
        const InputColumns inputs = norm ? InputColumns(kRow, 8, 32) : InputColumns(kRow);
        Actor actor(config, inputs, actions, norm, Precision::fp32, at::kCPU, 3);
        EXPECT_LT(difference_of(actor), 1e-5f) << static_cast<int>(activation) << norm;
      }
}

TEST(PlainNetwork, RoundsToHalfPrecisionAsEvolutionDoes) {
  for (const float x : {0.0f, -0.1f, 1.0009765f, 1.0014648f, 65504.0f, 65519.0f, 6.1e-5f, 5.97e-8f, 2.9e-8f, 3.0e-8f,
                        -1234.567f, 0.333333343f})
    EXPECT_EQ(rounded_to_half_precision(x), at::full({1}, x).to(at::kHalf).to(at::kFloat).item<float>()) << x;
  EXPECT_EQ(rounded_to_half_precision(65520.0f), INFINITY);
  ActorConfig config;
  config.hidden = {32};
  config.output_gain = 1;
  config.activation = Activation::relu;
  Actor actor(config, InputColumns(kRow), ActionKind::continuous, false, Precision::fp16, at::kCPU, 5);
  EXPECT_LT(difference_of(actor), 1e-5f);
}

TEST(PlainNetwork, DamagedBytesAreRefused) {
  ActorConfig config;
  config.hidden = {4};
  const Actor actor(config, InputColumns(8), ActionKind::discrete, false, Precision::fp32, at::kCPU, 1);
  const std::string bytes = network_bytes(plain_network_of(actor, 8, true));
  EXPECT_TRUE(read_network(bytes).greedy);
  EXPECT_THROW(read_network(bytes.substr(0, bytes.size() - 1)), Error);
  EXPECT_THROW(read_network(bytes + "x"), Error);
}

/// A game of two networks, greedy ones, here and as `gigastep record` plays it with LibTorch: the same, bit for bit.
TEST(PlaySession, PlaysTheGameThatRecordPlays) {
  at::set_num_threads(1);  // these networks are too small to be divided
  for (const char* name : {"waypoint_5_vs_3", "identical_2_vs_2_cont"}) {
    const Scenario scenario = load_scenario(name, data_dirs());
    const SimSpec spec = compile(scenario);
    ActorConfig config;
    config.hidden = {32, 32};
    config.output_gain = 3;
    std::shared_ptr<const PlainNetwork> network[kNTeams];
    std::array<RecordedTeam, kNTeams> teams;
    std::vector<Actor> actors;
    for (uint64_t team = 0; team < kNTeams; ++team)
      actors.emplace_back(config, input_columns(NetworkInputs::all, spec), spec.params.actions, false, Precision::fp32,
                          at::kCPU, team);
    for (size_t team = 0; team < kNTeams; ++team) {
      network[team] =
          std::make_shared<const PlainNetwork>(plain_network_of(actors[team], spec.observation_size(), true));
      teams[team] = {policy_controller(actors[team], true), {}, "a"};
    }
    const Replay replay = record_match(scenario, spec, teams, {1, 11, {}, 1}, "0.1.0").replay;
    PlaySession session(spec, 11, {Scripted::noop, network[0]}, {Scripted::noop, network[1]}, -1);
    int steps = 0;
    for (; !session.over(); ++steps) session.step({1, 1, 1});
    const ReplayEpisode& e = replay.episodes.at(0);
    ASSERT_EQ(steps, e.steps) << name;
    const StateView& state = session.state().view();
    for (int i = 0; i < spec.params.n_agents; ++i) {
      const float unit = replay.place_unit();
      EXPECT_EQ(std::lround(state.x[i] / unit), e.x[static_cast<size_t>((i + 1) * (steps + 1) - 1)]) << name << i;
    }
  }
}

}  // namespace
}  // namespace giga::test
