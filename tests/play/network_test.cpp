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

at::Tensor random_rows(uint32_t step = 0) {
  at::Tensor rows = at::empty({kRows, kRow});
  DrawKey key(7, 0, step);
  for (int64_t k = 0; k < rows.numel(); ++k)
    rows.data_ptr<float>()[k] =
        4 * key.uniform(Draw::init, static_cast<uint32_t>(k / kRow), static_cast<uint32_t>(k % kRow)) - 2;
  rows.narrow(1, kInputs, kRow - kInputs).zero_();  // as behind the last number of a row
  return rows;
}

/// The largest difference of two rows of numbers; NaN where one is.
float difference_of(const std::vector<float>& row, const float* expected) {
  float largest = 0;
  for (size_t k = 0; k < row.size(); ++k) {
    const float apart = std::fabs(row[k] - expected[k]);
    if (std::isnan(apart)) return apart;
    largest = std::max(largest, apart);
  }
  return largest;
}

/// Holds the network, after it went through bytes, to the actor for some steps. In the middle one every third row
/// begins an episode.
void expect_same(Actor& actor, uint32_t steps = 1) {
  at::NoGradGuard no_grad;
  at::set_num_threads(1);  // these networks are too small to be divided
  if (actor.normalizes()) actor.normalizer().update(random_rows() * 3 + 1, at::ones({kRows}));
  const PlainNetwork network = read_network(network_bytes(plain_network_of(actor, kInputs, false)));
  EXPECT_EQ(static_cast<int64_t>(network.inputs()), kInputs);
  const size_t size = network.memory.state_size();
  ASSERT_EQ(static_cast<int64_t>(size), actor.state_size());
  const int outputs = actor.actions() == ActionKind::discrete ? kNDiscreteActions : kActionSize;
  NetworkState state;
  std::vector<std::vector<float>> memory(kRows, std::vector<float>(size, 0));
  for (uint32_t step = 0; step < steps; ++step) {
    if (step > 0 && step == steps / 2) {
      state.reset(at::arange(kRows) % 3 == 0);
      for (size_t row = 0; row < kRows; row += 3) memory[row].assign(size, 0);
    }
    const at::Tensor rows = random_rows(step), heads = actor.forward(rows, state).contiguous();
    for (int64_t row = 0; row < kRows; ++row) {
      std::vector<float> head(static_cast<size_t>(outputs), NAN);
      std::vector<float>& remembered = memory[static_cast<size_t>(row)];
      network.forward(rows.const_data_ptr<float>() + row * kRow, remembered.data(), head.data());
      const float* expected = heads.const_data_ptr<float>() + row * heads.size(1);
      EXPECT_LT(difference_of(head, expected), 1e-5f) << "step " << step << " row " << row;
      EXPECT_EQ(std::max_element(head.begin(), head.end()) - head.begin(),
                std::max_element(expected, expected + outputs) - expected)
          << "step " << step << " row " << row;
      if (size == 0) continue;
      EXPECT_LT(difference_of(remembered, state.rows[row].contiguous().const_data_ptr<float>()), 1e-5f)
          << "what is remembered after step " << step << " by row " << row;
    }
  }
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
        SCOPED_TRACE(testing::Message() << static_cast<int>(activation) << norm);
        expect_same(actor);
      }
}

ActorConfig remembering(MemoryKind kind) {
  ActorConfig config;
  config.hidden = {32};
  config.output_gain = 3;
  config.memory = kind;
  config.memory_size = 24;
  return config;
}

TEST(PlainNetwork, RemembersAsLibTorchDoes) {
  for (const MemoryKind kind : {MemoryKind::gru, MemoryKind::lstm})
    for (const bool norm : {false, true}) {
      const InputColumns inputs = norm ? InputColumns(kRow, 8, 32) : InputColumns(kRow);
      Actor actor(remembering(kind), inputs, norm ? ActionKind::continuous : ActionKind::discrete, norm,
                  Precision::fp32, at::kCPU, 3);
      SCOPED_TRACE(testing::Message() << static_cast<int>(kind) << norm);
      expect_same(actor, 40);
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
  expect_same(actor);
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
void expect_same_game(const char* name, const std::array<ActorConfig, kNTeams>& configs) {
  const Scenario scenario = load_scenario(name, data_dirs());
  const SimSpec spec = compile(scenario);
  std::shared_ptr<const PlainNetwork> network[kNTeams];
  std::array<RecordedTeam, kNTeams> teams;
  std::vector<Actor> actors;
  for (uint64_t team = 0; team < kNTeams; ++team)
    actors.emplace_back(configs[team], input_columns(NetworkInputs::all, spec), spec.params.actions, false,
                        Precision::fp32, at::kCPU, team);
  for (size_t team = 0; team < kNTeams; ++team) {
    network[team] = std::make_shared<const PlainNetwork>(plain_network_of(actors[team], spec.observation_size(), true));
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

TEST(PlaySession, PlaysTheGameThatRecordPlays) {
  at::set_num_threads(1);  // these networks are too small to be divided
  ActorConfig plain;
  plain.hidden = {32, 32};
  plain.output_gain = 3;
  expect_same_game("waypoint_5_vs_3", {plain, remembering(MemoryKind::lstm)});
  expect_same_game("identical_2_vs_2_cont", {remembering(MemoryKind::gru), plain});
}

}  // namespace
}  // namespace giga::test
