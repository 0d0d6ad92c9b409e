// Mappo with frozen opponents: who moves which worlds, and what is learned from.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "league_games.hpp"

namespace giga::test {
namespace {

TEST(LearnLeague, ScriptsAndPastPoliciesMoveTheirWorlds) {
  // Half of 24 worlds is 12: 6 against scripts, three of each, and 2 groups of 2 against the pool.
  LeagueGames games(
      with_opponents("pool_size: 2, pool_share: 0.4, scripted: [circle, reverse_circle], scripted_share: 0.5"));
  ASSERT_EQ(games.shares.scripted, 6);
  ASSERT_EQ(games.shares.pooled(), 4);
  games.collect();
  // Indices of the 27 actions: 13 is straight on, three more a turn to the left.
  constexpr int kLeft = 16, kRight = 10;
  for (int learner = 0; learner < 2; ++learner) {
    const at::Tensor action = games.collector.rollout().team[1 - learner].action;  // [T, W, 2]
    const WorldRange scripts = games.shares.scripts(learner).in_shard;
    EXPECT_TRUE((action.narrow(1, scripts.first, 3) == kLeft).all().item<bool>());
    EXPECT_TRUE((action.narrow(1, scripts.first + 3, 3) == kRight).all().item<bool>());
    const at::Tensor rest = action.narrow(1, games.shares.pool(learner).in_shard.first, 4);
    EXPECT_GT(std::get<0>(at::_unique(rest)).size(0), 10) << "a network draws from all actions";
  }
}

// Two shards of 12 worlds: of a half of 6, 3 against scripts and one group of 2 against the pool.
TEST(LearnLeague, EachShardHasItsOpponents) {
  LeagueGames games(with_opponents("pool_size: 2, pool_share: 0.4, scripted: [circle], scripted_share: 0.5"), 2);
  ASSERT_EQ(games.shares.scripted, 3);
  ASSERT_EQ(games.shares.pooled(), 2);
  games.collect();
  constexpr int kLeft = 16;
  for (int64_t shard = 0; shard < 2; ++shard)
    for (int learner = 0; learner < 2; ++learner) {
      const at::Tensor action = games.collector.rollout().team[1 - learner].action;  // [T, W, 2]
      const auto circles = [&](const WorldRange& w) {
        return (action.narrow(1, w.first, w.count) == kLeft).all().item<bool>();
      };
      EXPECT_TRUE(circles(games.shares.scripts(learner).of(shard)));
      EXPECT_FALSE(circles(games.shares.pool(learner).of(shard)));
      EXPECT_FALSE(circles(games.shares.self_play().of(shard)));
    }
}

TEST(LearnLeague, WhileThePoolIsEmptyThePresentPolicyPlays) {
  // Its actions are drawn with the same numbers, whoever learns from them.
  const auto same = [](const SmallRun& a, const SmallRun& b) {
    LeagueGames one(a), other(b);
    one.collect();
    other.collect();
    at::Tensor x = one.collector.rollout().team[0].action[0], y = other.collector.rollout().team[0].action[0];
    at::Tensor u = one.collector.rollout().team[1].action[0], v = other.collector.rollout().team[1].action[0];
    return ((x - y).abs().max() < 1e-4).item<bool>() && ((u - v).abs().max() < 1e-4).item<bool>();
  };
  for (const char* actions : {"action: discrete\n", "action: continuous\n"}) {
    SmallRun pool = with_opponents("pool_size: 3, pool_share: 1"), none = with_opponents("pool_size: 3, pool_share: 0");
    pool.scenario = none.scenario = actions;
    pool.mappo = none.mappo = "obs_norm: true";
    EXPECT_TRUE(same(pool, none)) << actions;
  }
}

TEST(LearnLeague, EachGroupPlaysItsPolicy) {
  // Three policies that always take another action: a bias of the last layer towards it.
  LeagueGames games(with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.5"));
  for (int k = 0; k < 3; ++k) {
    for (PpoTeam& team : games.team) {
      at::NoGradGuard no_grad;
      const at::Tensor& values = team.actor().parameters().values();  // the last bias stands at the end
      values.zero_();
      values[values.size(0) - kLogitStride + 5 * k + 1] = 100;
    }
    games.league.end(k + 1, *games.sim);
  }
  games.collect();
  NamedArrays arrays;
  games.league.save("", arrays);
  for (int learner = 0; learner < 2; ++learner) {
    const auto rows = array_values<int32_t>(find_array(arrays, cat("team_", 1 - learner, "/row")));
    const at::Tensor action = games.collector.rollout().team[1 - learner].action;
    const WorldRange worlds = games.shares.pool(learner).in_shard;
    ASSERT_EQ(worlds.count, 6);  // three groups of two
    for (int64_t g = 0; g < 3; ++g)
      EXPECT_TRUE((action.narrow(1, worlds.first + 2 * g, 2) == 5 * (rows.at(static_cast<size_t>(g)) - 1) + 1)
                      .all()
                      .item<bool>())
          << "group " << g << " of the opponents of team " << learner;
  }
}

// Of two networks with memory in one group of worlds each, every row remembers what its own network would.
TEST(LearnLeague, EachGroupRemembersByItsOwnPolicy) {
  at::NoGradGuard no_grad;
  ActorConfig config;
  config.hidden = {8};
  config.memory = MemoryKind::gru;
  config.memory_size = 5;
  const auto make = [&](uint64_t seed) {
    return Actor(config, 6, ActionKind::discrete, true, Precision::fp32, at::kCPU, seed);
  };
  const Actor a = make(1), b = make(2);
  GroupPolicy groups(a, config, Precision::fp32);
  ASSERT_EQ(groups.state_size(), 5);
  groups.set(at::stack({GroupPolicy::row_of(a), GroupPolicy::row_of(b)}));
  NetworkState state, state_a, state_b;
  state.rows = at::zeros({6, 5});
  at::Generator generator = at::detail::createCPUGenerator(3);
  for (int t = 0; t < 3; ++t) {
    const at::Tensor obs = at::randn({6, 6}, generator);
    const at::Tensor head = groups.forward(obs, state);
    const at::Tensor expected =
        at::cat({a.forward(obs.narrow(0, 0, 3), state_a), b.forward(obs.narrow(0, 3, 3), state_b)});
    EXPECT_LT((head - expected).abs().max().item<double>(), 1e-5) << "step " << t;
    ASSERT_EQ(state.rows.sizes(), at::IntArrayRef({6, 5}));
    EXPECT_LT((state.rows - at::cat({state_a.rows, state_b.rows})).abs().max().item<double>(), 1e-5) << "step " << t;
  }
}

Rollout copy_of(const Rollout& rollout) {
  const auto copy = [](const at::Tensor& x) { return x.defined() ? x.clone() : x; };
  Rollout result;
  for (int team = 0; team < kNTeams; ++team) {
    const TeamRollout& r = rollout.team[team];
    result.team[team] = {copy(r.obs),      copy(r.alive),  copy(r.action),    copy(r.pre_tanh_action),
                         copy(r.log_prob), copy(r.reward), copy(r.final_obs), copy(r.final_alive)};
    result.team[team].state = copy(r.state);
  }
  result.done = copy(rollout.done);
  result.true_state = copy(rollout.true_state);
  result.final_true_state = copy(rollout.final_true_state);
  return result;
}

/// Makes everything in the worlds in which `team` does not learn useless to learn from.
void spoil_frozen(Rollout& rollout, int team, const ShardRange& learning) {
  constexpr double kSpoiled = std::numeric_limits<double>::quiet_NaN();
  at::Tensor frozen = at::ones({kSmallRunWorlds}, at::kBool);
  for (const WorldRange& worlds : learning.pieces(kSmallRunWorlds))
    frozen.narrow(0, worlds.first, worlds.count).fill_(false);
  const at::Tensor worlds = frozen.nonzero().squeeze(1);
  const auto spoil = [&](const at::Tensor& x, int64_t dim) {
    if (x.defined() && x.is_floating_point()) x.index_fill_(dim, worlds, kSpoiled);
  };
  const TeamRollout& r = rollout.team[team];
  for (const at::Tensor& x : {r.obs, r.pre_tanh_action, r.log_prob, r.reward, rollout.true_state}) spoil(x, 1);
  for (const at::Tensor& x : {r.final_obs, rollout.final_true_state, r.state}) spoil(x, 0);
}

// Everything in which a NaN could hide: advantages by minibatch and batch, both normalisers, all critics' inputs.
TEST(LearnLeague, FrozenRowsTakeNoPartInLearning) {
  constexpr const char* kOpponents = "pool_size: 2, pool_share: 0.4, scripted_share: 0.2";
  SmallRun discrete = with_opponents(kOpponents), continuous = with_opponents(kOpponents);
  continuous.scenario = "action: continuous\n";
  continuous.mappo = "obs_norm: true, advantage_norm: batch";
  continuous.critic = "kind: state, hidden: [16, 12]";
  SmallRun remembering = with_opponents(kOpponents);
  remembering.actor = remembering.critic = "memory: gru, memory_size: 6, hidden: [8]";
  for (const auto& [small, n_shards] :
       {std::pair{discrete, 1}, {continuous, 1}, {discrete, 2}, {continuous, 3}, {remembering, 2}}) {
    LeagueGames clean(small, n_shards), spoilt(small, n_shards);
    for (int64_t u = 0; u < 2; ++u) {
      clean.collect();
      const int64_t own = clean.team[0].n_sequences();
      for (int team = 0; team < kNTeams; ++team) {
        Rollout rollout = copy_of(clean.collector.rollout());
        const auto learn = [&](PpoTeam& of) {
          StepSettings settings = StepSettings::of(clean.run.config.mappo);
          settings.actor_step_size = settings.critic_step_size = 1e-3f;
          of.set(settings);
          of.compute_advantages(rollout);
          of.begin_epoch(rollout, at::arange(own, at::kLong));
          for (int k = 0; k < clean.run.config.mappo.n_minibatches; ++k) of.update_minibatch(rollout, k, k + 1);
          of.update_normalizer(rollout);
          NamedArrays arrays;
          of.save("", arrays);
          return arrays;
        };
        const NamedArrays expected = learn(clean.team[team]);
        spoil_frozen(rollout, team, clean.shares.learning(team));
        const NamedArrays actual = learn(spoilt.team[team]);
        EXPECT_EQ(difference(expected, actual), "") << "team " << team << ", update " << u;
        expect_finite(actual);
        const at::Tensor figures = clean.team[team].figures();
        EXPECT_TRUE(at::equal(figures, spoilt.team[team].figures())) << "team " << team << ", update " << u;
        EXPECT_EQ(figures.slice(0, kFirstFault).sum().item<float>(), 0);
        EXPECT_EQ(spoilt.team[team].faulty_states(rollout, 1000).size(0), 0);
      }
    }
  }
}

TEST(LearnLeague, StatesAreThoseOfTheLearningWorlds) {
  const LeagueGames games(with_opponents("pool_size: 2, pool_share: 0.4, scripted_share: 0.2"));
  // Of 12: 2.4 against scripts, 4.8 against two policies: 2 + 4 worlds for each team; 18 of 24 are learned from.
  ASSERT_EQ(games.shares.learning(1), (ShardRange{{6, 18}, 24}));
  const at::Tensor own = at::tensor({int64_t{0}, int64_t{17}, int64_t{18}, int64_t{36 + 5}});
  // Steps 0, 0, 1, 2 and worlds 0, 17, 0, 5 of the team's.
  EXPECT_TRUE(
      at::equal(games.team[0].states(own), at::tensor({int64_t{0}, int64_t{17}, int64_t{24}, int64_t{48 + 5}})));
  EXPECT_TRUE(
      at::equal(games.team[1].states(own), at::tensor({int64_t{6}, int64_t{23}, int64_t{30}, int64_t{48 + 11}})));
}

}  // namespace
}  // namespace giga::test
