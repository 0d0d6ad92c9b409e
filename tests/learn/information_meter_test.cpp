// The meter of mutual information: who is dead or whose game is over does not count, and what it asks the policies is
// what their agents see.
#include "eval/information_meter.hpp"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <cmath>
#include <functional>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "policy/actor.hpp"
#include "policy/mutual_information.hpp"
#include "recorded.hpp"
#include "rollout/tensors.hpp"
#include "sim/row_layout.hpp"

namespace giga::test {
namespace {

/// A policy that is certain of one action in each row: `action(k, row)` at the k-th time that it is asked.
struct Certain final : Policy {
  explicit Certain(std::function<int64_t(int64_t, int64_t)> wanted) : action(std::move(wanted)) {}
  using Policy::forward;
  at::Tensor forward(const at::Tensor& obs, NetworkState&) const override {
    at::Tensor logits = at::zeros({obs.size(0), kLogitStride});
    for (int64_t row = 0; row < obs.size(0); ++row) logits[row][action(times, row)] = 200;
    ++times;
    return logits;
  }
  ActionKind actions() const override { return ActionKind::discrete; }
  at::Tensor log_std() const override { return {}; }

  std::function<int64_t(int64_t, int64_t)> action;
  mutable int64_t times = 0;
};

/// Notes whether the agents of team 0 live after each step.
struct Living final : GameObserver {
  void after_step(int64_t, const GameStep& step) override {
    const SimParams& p = step.sim->params();
    const uint8_t* alive = step.sim->state().view().alive;
    now.clear();
    for (int w = 0; w < step.sim->n_worlds(); ++w)
      for (int i = 0; i < p.n_team[0]; ++i) now.push_back(alive[w * p.n_agents + i] != 0);
  }
  std::vector<bool> now;  // [W n]
};

/// Two against one on an empty map where nobody shoots or collides, for at most 150 steps.
LoadedRun two_against_one() {
  return load_run_config_text("seed: 1\n", R"(
max_episode_length: 150
maps: empty
team_0: [{type: default, count: 2}]
team_1: [{type: default, count: 1}]
damage: {damage_cone_depth: 0}
collision: {collision_range: 0}
)");
}

std::array<std::optional<double>, kNTeams> measured(const Policy& policy, Scripted script, Living& living) {
  const LoadedRun run = two_against_one();
  InformationMeter meter(run.spec, {Mind{&policy}, Mind{}});
  play_match(run.spec, script_controller(script), script_controller(Scripted::circle), {6, 4, {}, 2},
             {&living, &meter});
  return meter.nats();
}

TEST(LearnInformationMeter, AfterTheEndNobodyActs) {
  // All circle for 150 steps: 150 times the first of two agents is certain of action 0, the second of 5. What they make
  // of the end, all of them action 7, they do not do.
  const Certain policy([](int64_t k, int64_t row) { return k == 150 ? 7 : row % 2 == 0 ? 0 : 5; });
  Living living;
  const auto nats = measured(policy, Scripted::circle, living);
  EXPECT_EQ(policy.times, 151);
  EXPECT_NEAR(nats[0].value(), std::log(2.0), 1e-6);
  EXPECT_FALSE(nats[1]) << "a script";
}

TEST(LearnInformationMeter, TheDeadDoNotAct) {
  // They fly straight on and leave the map, one before the other: the living are certain of action 0, the dead of 5.
  Living living;
  int64_t dead_among_living = 0;
  const Certain policy([&](int64_t, int64_t row) {
    const bool lives = living.now.at(static_cast<size_t>(row));
    dead_among_living += !lives && living.now.at(static_cast<size_t>(row ^ 1));
    return lives ? 0 : 5;
  });
  const auto nats = measured(policy, Scripted::noop, living);
  EXPECT_GT(dead_among_living, 10);
  EXPECT_NEAR(nats[0].value(), 0, 1e-9);
}

/// Asks a policy of all that it sees at once, in the place of step by step.
struct AtOnce final : GameObserver {
  AtOnce(const SimSpec& spec, const Policy& of) : stride(observation_rows(spec).stride()), policy(of) {}
  void before_step(int64_t, GameStep& step) override { step.rows[0].wanted |= policy.reads(); }
  void after_step(int64_t, const GameStep& step) override {
    const Simulator& sim = *step.sim;
    const int64_t w = sim.n_worlds(), n = sim.params().n_team[0];
    const StateView& view = sim.state().view();
    const auto host = [&](const void* data, int64_t columns) {
      return wrap(static_cast<const uint8_t*>(data), {w, columns}, sim.device()).to(at::kCPU, at::kFloat);
    };
    obs.push_back(wrap(step.rows[0].obs, {w * n, stride}, sim.device()).clone());
    const at::Tensor plays = host(view.phase, 1).eq(0);
    weight.push_back((host(view.alive, sim.params().n_agents).narrow(1, 0, n) * plays).reshape({-1}));
  }
  double nats(bool greedy) const {
    at::NoGradGuard no_grad;
    const at::Tensor head = policy.forward(at::cat(obs));
    return mutual_information(information_sums(policy, head, at::cat(weight).to(head), greedy)).item<double>();
  }
  int64_t stride;
  const Policy& policy;
  std::vector<at::Tensor> obs, weight;
};

void expect_as_at_once(Device device) {
  for (const char* action : {"", "action: continuous\n"})
    for (const bool greedy : {false, true}) {
      SmallRun small = recorded_run();
      if (device.is_cuda()) small.precision = "tf32";
      small.scenario = action;
      const LoadedRun run = small.load();
      const auto learner = small.learner(device);
      InformationMeter meter(run.spec, {Mind{learner->actor(0), nullptr, greedy}, Mind{learner->actor(1)}});
      AtOnce at_once(run.spec, *learner->actor(0));
      play_games(run, *learner, {&meter, &at_once}, device);
      const auto nats = meter.nats();
      EXPECT_NEAR(nats[0].value(), at_once.nats(greedy), 1e-4);
      EXPECT_GT(nats[0].value(), 1e-3) << "else this shows nothing";
      EXPECT_GT(nats[1].value(), 0);
    }
}

TEST(LearnInformationMeter, StepsAddUp) { expect_as_at_once({}); }

TEST(LearnInformationMeterGpu, StepsAddUp) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  expect_as_at_once({Device::Kind::cuda, 0});
}

}  // namespace
}  // namespace giga::test
