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
#include "sim/image_rows.hpp"
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

/// Notes which agents of a team live after each step.
struct Living final : GameObserver {
  explicit Living(int of) : team(of) {}
  void after_step(int64_t, const GameStep& step) override {
    const SimParams& p = step.sim->params();
    const uint8_t* alive = step.sim->state().view().alive;
    now.clear();
    for (int w = 0; w < step.sim->n_worlds(); ++w)
      for (int i = 0; i < p.n_team[team]; ++i) now.push_back(alive[w * p.n_agents + (team ? p.n_team[0] : 0) + i] != 0);
  }
  const int team;
  std::vector<bool> now;  // [W n]
};

/// Two against three on an empty map where nobody shoots or collides, for at most 150 steps.
LoadedRun two_against_three() {
  return load_run_config_text("seed: 1\n", R"(
max_episode_length: 150
maps: empty
team_0: [{type: default, count: 2}]
team_1: [{type: default, count: 3}]
damage: {damage_cone_depth: 0}
collision: {collision_range: 0}
)");
}

/// What is measured of a team that a script moves, against one that circles.
double measured(const Policy& policy, int team, Scripted script, Living& living) {
  const LoadedRun run = two_against_three();
  Minds minds;
  minds[static_cast<size_t>(team)].policy = &policy;
  InformationMeter meter(run.spec, minds);
  const Scripted other = Scripted::circle;
  play_match(run.spec, script_controller(team == 0 ? script : other), script_controller(team == 1 ? script : other),
             {6, 4, {}, 2}, {&living, &meter});
  EXPECT_FALSE(meter.nats()[static_cast<size_t>(1 - team)]) << "nobody was asked";
  return meter.nats()[static_cast<size_t>(team)].value();
}

TEST(LearnInformationMeter, AfterTheEndNobodyActs) {
  // All circle for 150 steps: 150 times the first of two agents is certain of action 0, the second of 5. What they make
  // of the end, all of them action 7, they do not do.
  const Certain policy([](int64_t k, int64_t row) { return k == 150 ? 7 : row % 2 == 0 ? 0 : 5; });
  Living living(0);
  EXPECT_NEAR(measured(policy, 0, Scripted::circle, living), std::log(2.0), 1e-6);
  EXPECT_EQ(policy.times, 151);
}

TEST(LearnInformationMeter, TheDeadDoNotAct) {
  // They fly straight on and leave the map, one before the other: the living are certain of action 0, the dead of 5.
  for (const int team : {0, 1}) {
    Living living(team);
    const int64_t n = team == 0 ? 2 : 3;
    int64_t dead_among_living = 0;
    const Certain policy([&](int64_t, int64_t row) {
      const auto lives = [&](int64_t at) { return static_cast<bool>(living.now.at(static_cast<size_t>(at))); };
      dead_among_living += !lives(row) && lives(row - row % n + (row + 1) % n);
      return lives(row) ? 0 : 5;
    });
    const double nats = measured(policy, team, Scripted::noop, living);
    EXPECT_GT(dead_among_living, 10);
    EXPECT_EQ(nats, 0) << "team " << team;
  }
}

/// Adds up in another way: all heads of a team first, then their information. Steps are asked one by one all the same,
/// since products round by their number of rows.
struct AllHeads final : GameObserver {
  AllHeads(const SimSpec& spec, int of, const Policy& asked)
      : stride(observation_rows(spec).stride()), team(of), policy(asked) {}
  void before_step(int64_t, GameStep& step) override { step.rows[team].wanted |= policy.reads(); }
  void after_step(int64_t, const GameStep& step) override {
    at::NoGradGuard no_grad;
    const Simulator& sim = *step.sim;
    const SimParams& p = sim.params();
    const int64_t w = sim.n_worlds(), n = p.n_team[team];
    const StateView& view = sim.state().view();
    const auto host = [&](const void* data, int64_t columns) {
      return wrap(static_cast<const uint8_t*>(data), {w, columns}, sim.device()).to(at::kCPU, at::kFloat);
    };
    const void* images = step.io.team[team].obs[Observation::image].rows;
    const at::Tensor obs = policy.reads_image() ? wrap(static_cast<const uint8_t*>(images),
                                                       {w * n, image_bytes(p.resolution)}, sim.device())
                                                : wrap(step.rows[team].obs, {w * n, stride}, sim.device());
    heads.push_back(policy.forward(obs, memory));
    const at::Tensor plays = host(view.phase, 1).eq(0);
    weights.push_back((host(view.alive, p.n_agents).narrow(1, team * p.n_team[0], n) * plays).reshape({-1}));
  }
  double nats(bool greedy) const {
    const at::Tensor head = at::cat(heads);
    return mutual_information(information_sums(policy, head, at::cat(weights).to(head), greedy)).item<double>();
  }
  const int64_t stride;
  const int team;
  const Policy& policy;
  NetworkState memory;
  std::vector<at::Tensor> heads, weights;
};

void expect_sum_of_steps(const SmallRun& small, bool greedy, Device device) {
  SCOPED_TRACE(small.actor + " " + small.scenario);
  const LoadedRun run = small.load();
  const auto learner = small.learner(device);
  InformationMeter meter(run.spec, {Mind{learner->actor(0), nullptr, greedy}, Mind{learner->actor(1)}});
  AllHeads first(run.spec, 0, *learner->actor(0)), second(run.spec, 1, *learner->actor(1));
  play_games(run, *learner, {&meter, &first, &second}, device);
  const auto nats = meter.nats();
  EXPECT_NEAR(nats[0].value(), first.nats(greedy), 1e-4);
  EXPECT_NEAR(nats[1].value(), second.nats(false), 1e-4);
  EXPECT_GT(nats[0].value(), 1e-3) << "else this shows nothing";
  EXPECT_GT(nats[1].value(), 1e-4);
}

void expect_sums_of_steps(Device device) {
  SmallRun small = recorded_run();
  if (device.is_cuda()) small.precision = "tf32";
  for (const char* action : {"", "action: continuous\n"})
    for (const bool greedy : {false, true}) {
      small.scenario = action;
      expect_sum_of_steps(small, greedy, device);
    }
  small.scenario = "";
  small.actor = "hidden: [16, 16], output_gain: 3, memory: gru, memory_size: 8";
  expect_sum_of_steps(small, false, device);
  small.actor = "encoder: impala, impala_width: 4, hidden: [16], output_gain: 3";
  small.critic = "kind: state, hidden: [16, 16]";
  small.scenario = "observation: {type: rgb, resolution: 16}\n";
  expect_sum_of_steps(small, false, device);
}

TEST(LearnInformationMeter, IsTheSumOfTheSteps) { expect_sums_of_steps({}); }

TEST(LearnInformationMeterGpu, IsTheSumOfTheSteps) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  expect_sums_of_steps({Device::Kind::cuda, 0});
}

// More agents than tables of pairs take; and a match that begins anew counts once.
TEST(LearnInformationMeter, OfACrowd) {
  SmallRun small = recorded_run();
  small.scenario =
      "max_episode_length: 8\nlimit_x: 60\nlimit_y: 60\nteam_0: [{type: default, count: 600}]\n"
      "team_1: [{type: default, count: 500}]\n";
  expect_sum_of_steps(small, false, {});
}

TEST(LearnInformationMeter, OfTheLastMatch) {
  const LoadedRun run = recorded_run().load();
  const auto learner = recorded_run().learner();
  InformationMeter meter(run.spec, {Mind{learner->actor(0)}, Mind{}});
  play_games(run, *learner, {&meter});
  const auto once = meter.nats();
  play_games(run, *learner, {&meter});
  EXPECT_EQ(meter.nats(), once);
}

}  // namespace
}  // namespace giga::test
