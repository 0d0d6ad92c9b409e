// Recording: a replay holds the simulator's states and what the networks say of them, and plays again to the same bits.
#include "eval/record.hpp"

#include <gtest/gtest.h>
#include <torch/types.h>

#include "game/game.hpp"
#include "learn/players/value_function.hpp"
#include "learn/team_policy.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/tensors.hpp"
#include "runs.hpp"
#include "sim/row_layout.hpp"

namespace giga::test {
namespace {

/// Keeps what a recorder should have seen of world 1.
struct Witness final : GameObserver {
  explicit Witness(const LoadedRun& loaded) : run(loaded) {}
  void before_step(int64_t, GameStep& step) override {
    for (auto& rows : step.rows) rows.wanted |= ObservationSet::all();
  }
  void after_step(int64_t t, const GameStep& step) override {
    const SimParams& p = run.spec.params;
    const WorldView w = world_view(step.sim->state().view(), p.n_agents, 1);
    if (over) return;
    x.push_back({w.x, w.x + p.n_agents});
    heading.push_back({w.heading, w.heading + p.n_agents});
    detected.push_back({w.detected, w.detected + p.n_agents});
    seen.push_back({w.seen, w.seen + p.n_agents});
    alive.push_back({w.alive, w.alive + p.n_agents});
    const int stride = observation_rows(run.spec).stride();
    const float* rows = step.rows[0].obs + int64_t{p.n_team[0]} * stride;
    obs.push_back({rows, rows + int64_t{p.n_team[0]} * stride});
    if (t >= 0) {
      const auto* action = static_cast<const int32_t*>(step.team[0].action) + p.n_team[0];
      actions.push_back({action, action + p.n_team[0]});
    }
    over = *w.phase == Phase::waits;
  }
  const LoadedRun& run;
  bool over = false;
  std::vector<std::vector<float>> x, heading, obs;
  std::vector<std::vector<uint32_t>> detected, seen;
  std::vector<std::vector<uint8_t>> alive;
  std::vector<std::vector<int32_t>> actions;
};

SmallRun small_run() {
  SmallRun small;
  small.actor = "hidden: [16, 16], output_gain: 3";
  return small;
}

struct Recorded {
  LoadedRun run = small_run().load();
  std::unique_ptr<Learner> learner = small_run().learner();
  NamedArrays critics;
  std::unique_ptr<ValueFunction> values;
  Replay replay;

  Recorded() {
    learner->save_critics(critics);
    values = ValueFunction::load(run, 0, critics, *learner->actor(0), {});
    const std::array<RecordedTeam, 2> teams = {
        RecordedTeam{policy_controller(*learner->actor(0)), {learner->actor(0), values.get()}, "a"},
        RecordedTeam{policy_controller(*learner->actor(1)), {}, "b"}};
    replay = record_match(run.scenario, run.spec, teams, {3, 5, {}, 2}, "0.1.0").replay;
  }
};

TEST(LearnRecord, KeepsWhatTheSimulatorSays) {
  const Recorded recorded;
  Witness witness(recorded.run);
  play_match(recorded.run.spec, policy_controller(*recorded.learner->actor(0)),
             policy_controller(*recorded.learner->actor(1)), {3, 5, {}, 2}, {&witness});
  const ReplayEpisode& e = recorded.replay.episodes.at(1);
  const int n = recorded.replay.n_agents(), states = e.steps + 1;
  ASSERT_EQ(static_cast<int>(witness.x.size()), states);
  const ReplayPairs pairs(recorded.replay);
  const auto bit = [&](const std::vector<uint8_t>& bits, int64_t pair, int k) {
    return bits[static_cast<size_t>(pair * ((states + 7) / 8) + k / 8)] >> (k & 7) & 1;
  };
  for (int k = 0; k < states; ++k) {
    const auto s = static_cast<size_t>(k);
    for (int i = 0; i < n; ++i) {
      const auto a = static_cast<size_t>(i), at = static_cast<size_t>(i * states + k);
      EXPECT_NEAR(e.x[at] * recorded.replay.place_unit(), witness.x[s][a], 0.51f * recorded.replay.place_unit());
      const float turn = static_cast<float>(e.heading[at]) * 2 * kPi / kReplayTurn - witness.heading[s][a];
      EXPECT_NEAR(turn - 2 * kPi * std::round(turn / (2 * kPi)), 0, 0.51f * 2 * kPi / 1024);
      EXPECT_EQ(e.died[a] < 0 || k < e.died[a], witness.alive[s][a] != 0) << "agent " << i << ", state " << k;
      for (int b = 0; b < n; ++b) {
        const bool other_team = recorded.run.spec.params.team_of(i) != recorded.run.spec.params.team_of(b);
        if (other_team) {
          EXPECT_EQ(bit(e.sees, pairs.opponents(i, b), k), witness.detected[s][a] >> b & 1);
        } else if (i != b && witness.alive[s][a]) {
          EXPECT_EQ(bit(e.hears, pairs.mates(i, b), k), witness.seen[s][a] >> b & 1);
        }
      }
    }
  }
}

TEST(LearnRecord, ActionsAndMindsBelongToTheirState) {
  const Recorded recorded;
  Witness witness(recorded.run);
  play_match(recorded.run.spec, policy_controller(*recorded.learner->actor(0)),
             policy_controller(*recorded.learner->actor(1)), {3, 5, {}, 2}, {&witness});
  const ReplayEpisode& e = recorded.replay.episodes.at(1);
  const ReplayMind& mind = e.mind[0];
  const int n = recorded.run.spec.params.n_team[0], states = e.steps + 1;
  ASSERT_EQ(mind.top, kLikelyActions);
  EXPECT_EQ(e.mind[1].top, 0) << "nobody asked team 1";
  float likeliest = 0;
  NetworkState memory;
  for (int k = 0; k < e.steps; ++k) {
    at::NoGradGuard no_grad;
    const auto s = static_cast<size_t>(k);
    const int stride = observation_rows(recorded.run.spec).stride();
    const at::Tensor obs = wrap(witness.obs[s].data(), {n, stride}, {});
    const at::Tensor chance = recorded.learner->actor(0)->forward(obs).narrow(1, 0, kNDiscreteActions).softmax(1);
    const at::Tensor alive = wrap(witness.alive[s].data(), {1, recorded.run.spec.params.n_agents}, {}).narrow(1, 0, n);
    const at::Tensor value = recorded.values->forward(obs.unsqueeze(0), alive, {}, memory);
    for (int i = 0; i < n; ++i) {
      const auto at = static_cast<size_t>(i * states + k);
      if (!witness.alive[s][static_cast<size_t>(i)]) {
        EXPECT_EQ(e.action[static_cast<size_t>(i * e.steps + k)], 13) << "the dead do nothing";
        EXPECT_EQ(mind.probability[at], 0);
        continue;
      }
      EXPECT_EQ(e.action[static_cast<size_t>(i * e.steps + k)], witness.actions[s][static_cast<size_t>(i)]);
      const float most = chance[i][mind.likely[at]].item<float>();
      EXPECT_FLOAT_EQ(most, chance[i].max().item<float>());
      EXPECT_NEAR(mind.probability[at] / 31.0f, most, 0.51f / 31);
      EXPECT_NEAR(mind.low + (mind.high - mind.low) * mind.value[at] / 63, value[0][i].item<float>(),
                  0.51f * (mind.high - mind.low) / 63 + 1e-5f);
      likeliest = std::max(likeliest, most);
    }
  }
  EXPECT_GT(likeliest, 0.2f) << "a policy that knows what it wants, so that the test sees mistakes";
}

TEST(LearnRecord, PlaysAgainAndNoticesWhatDiffers) {
  const Recorded recorded;
  EXPECT_EQ(verify_replay(recorded.replay, {}), "");
  Replay other = recorded.replay;
  other.episodes[2].state_check ^= 1;
  EXPECT_NE(verify_replay(other, {}).find("episode 2 differs by less than the replay keeps"), std::string::npos);
  other = recorded.replay;
  other.episodes[1].x[1] = static_cast<int16_t>(other.episodes[1].x[1] + 1);
  EXPECT_EQ(verify_replay(other, {}), "episode 1 differs from step 1 on");
  other = recorded.replay;
  other.seed = "6";
  EXPECT_NE(verify_replay(other, {}), "");
}

}  // namespace
}  // namespace giga::test
