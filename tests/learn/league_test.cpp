// Mappo with frozen opponents: who moves which worlds, what is learned from, and how games against past policies count.
#include "learn/opponents/league.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "learn/mappo/ppo_team.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

constexpr int kSmallRunWorlds = 24;  // of SmallRun

/// Both teams with their networks, and a league that collects rollouts; nothing is learned.
struct Games {
  explicit Games(const SmallRun& small, int64_t n_shards = 1)
      : run(small.load()),
        parallel_for(kCpu, 1),
        shares(world_shares(run.config.opponents, kSmallRunWorlds, n_shards)),
        team{{run, 0, kCpu, parallel_for, shares.learning(0)}, {run, 1, kCpu, parallel_for, shares.learning(1)}},
        league(run, shares, {&team[0].actor(), &team[1].actor()}, parallel_for),
        sim(make_cpu_simulator(run.spec, {kSmallRunWorlds, 17, 0, OnDone::reset, 1})),
        collector(*sim, parallel_for, {run.config.mappo.horizon, team[0].needs_state(), false},
                  {league.side(0), league.side(1)}) {
    collector.start();
  }
  void collect() {
    league.begin();
    collector.collect();
  }
  const LoadedRun run;
  const ParallelFor parallel_for;
  const WorldShares shares;
  PpoTeam team[kNTeams];
  League league;
  std::unique_ptr<Simulator> sim;
  Collector collector;
};

SmallRun with_opponents(const std::string& keys) {
  SmallRun run;
  run.more = "opponents: {" + keys + "}\n";
  return run;
}

TEST(LearnLeague, ScriptsAndPastPoliciesMoveTheirWorlds) {
  // Half of 24 worlds is 12: 6 against scripts, three of each, and 2 groups of 2 against the pool.
  Games games(with_opponents("pool_size: 2, pool_share: 0.4, scripted: [circle, reverse_circle], scripted_share: 0.5"));
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
  Games games(with_opponents("pool_size: 2, pool_share: 0.4, scripted: [circle], scripted_share: 0.5"), 2);
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
    Games one(a), other(b);
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
  Games games(with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.5"));
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
    Games clean(small, n_shards), spoilt(small, n_shards);
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
  const Games games(with_opponents("pool_size: 2, pool_share: 0.4, scripted_share: 0.2"));
  // Of 12: 2.4 against scripts, 4.8 against two policies: 2 + 4 worlds for each team; 18 of 24 are learned from.
  ASSERT_EQ(games.shares.learning(1), (ShardRange{{6, 18}, 24}));
  const at::Tensor own = at::tensor({int64_t{0}, int64_t{17}, int64_t{18}, int64_t{36 + 5}});
  // Steps 0, 0, 1, 2 and worlds 0, 17, 0, 5 of the team's.
  EXPECT_TRUE(
      at::equal(games.team[0].states(own), at::tensor({int64_t{0}, int64_t{17}, int64_t{24}, int64_t{48 + 5}})));
  EXPECT_TRUE(
      at::equal(games.team[1].states(own), at::tensor({int64_t{6}, int64_t{23}, int64_t{30}, int64_t{48 + 11}})));
}

/// Writes episodes, wins of team 0, wins of team 1 and ties of a world.
void set_stats(const Simulator& sim, int64_t world, std::array<float, 4> counts) {
  float* stats = sim.state().view().stats + world * kNStatRows;
  const EpisodeStat stat[] = {EpisodeStat::episodes, EpisodeStat::wins_0, EpisodeStat::wins_1, EpisodeStat::ties};
  for (size_t k = 0; k < 4; ++k) stats[static_cast<int>(stat[k])] = counts[k];
}

TEST(LearnLeague, GamesAgainstPastPoliciesCountFromTheirDrawOn) {
  Games games(with_opponents("pool_size: 2, pool_every_updates: 2, pool_share: 0.4, scripted_share: 0.2"));
  // Worlds: 0 and 1 scripts, 2 to 5 the pool of team 1; 18 to 21 the pool of team 0, 22 and 23 scripts.
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{2, 4}, 24}));
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{18, 4}, 24}));
  Simulator& sim = *games.sim;
  const auto counted = [&] {
    games.league.count(sim);
    sim.take_stats();
    EpisodeStats self_play;
    std::array<LeagueRecord, kNTeams> record;
    games.league.read(self_play, record);
    return std::pair{self_play, record};
  };
  for (int w = 0; w < kSmallRunWorlds; ++w) sim.state().view().episode_length[w] = w == 3 ? 0 : 5;
  sim.take_stats();
  games.league.end(2, sim);  // one policy of each team is kept and drawn
  games.league.begin();
  set_stats(sim, 0, {3, 1, 0, 2});   // scripts of team 0
  set_stats(sim, 2, {1, 1, 0, 0});   // began before its opponent was drawn
  set_stats(sim, 3, {2, 1, 0, 1});   // began with it
  set_stats(sim, 10, {4, 1, 2, 1});  // self-play
  set_stats(sim, 23, {2, 0, 1, 1});  // scripts of team 1
  const auto [self_play, record] = counted();
  EXPECT_EQ(self_play[EpisodeStat::episodes], 4);
  EXPECT_EQ(self_play[EpisodeStat::wins_1], 2);
  EXPECT_EQ(record[0].pool.episodes, 2);
  EXPECT_EQ(record[0].pool.wins, 1);
  EXPECT_EQ(record[0].pool.ties, 1);
  EXPECT_EQ(record[0].scripts.win_rate(), 1 / 3.0);
  EXPECT_EQ(record[1].pool.episodes, 0);
  EXPECT_EQ(record[1].scripts.win_rate(), 1 / 2.0);
  // The next games of worlds 2 and 20 have the same opponent from start to end; that of world 20 is its first to end.
  set_stats(sim, 2, {1, 0, 1, 0});
  set_stats(sim, 20, {1, 0, 1, 0});
  EXPECT_EQ(counted().second[0].pool.episodes, 1);
  set_stats(sim, 20, {1, 0, 1, 0});
  EXPECT_EQ(counted().second[1].pool.wins, 1);
  // Against policy 1 of team 1: 3 games, 1 win, 1 tie; of team 0: one game, won.
  NamedArrays arrays;
  games.league.save("", arrays);
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_1/games")), (std::vector<double>{3, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_1/wins")), (std::vector<double>{1.5, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_0/games")), (std::vector<double>{1, 0}));
  EXPECT_EQ(array_values<double>(find_array(arrays, "team_0/wins")), (std::vector<double>{1, 0}));
}

// Two shards of 12 worlds: 0 to 2 scripts of team 0, 3 and 4 the pool of team 1, a policy each, 7 and 8 the pool of
// team 0, 9 to 11 scripts of team 1; the second shard likewise from 12 on.
TEST(LearnLeague, GamesOfAllShardsCount) {
  Games games(with_opponents("pool_size: 2, pool_every_updates: 1, pool_share: 0.4, scripted_share: 0.5"), 2);
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{7, 2}, 12, 2}));
  Simulator& sim = *games.sim;
  std::fill_n(sim.state().view().episode_length, kSmallRunWorlds, 0);  // all games begin with their opponents
  games.league.end(1, sim);
  games.league.begin();
  set_stats(sim, 0, {1, 1, 0, 0});  // scripts of team 0, in both shards
  set_stats(sim, 14, {2, 1, 1, 0});
  set_stats(sim, 3, {1, 0, 1, 0});  // its pool, in both
  set_stats(sim, 16, {3, 2, 0, 1});
  set_stats(sim, 5, {5, 1, 1, 3});  // self-play, in both
  set_stats(sim, 18, {2, 0, 2, 0});
  set_stats(sim, 20, {4, 1, 3, 0});  // the pool of team 1
  set_stats(sim, 23, {2, 0, 2, 0});  // its scripts
  games.league.count(sim);
  EpisodeStats self_play;
  std::array<LeagueRecord, kNTeams> record;
  games.league.read(self_play, record);
  EXPECT_EQ(self_play[EpisodeStat::episodes], 7);
  EXPECT_EQ(record[0].scripts.episodes, 3);
  EXPECT_EQ(record[0].scripts.wins, 2);
  EXPECT_EQ(record[0].pool.episodes, 4);
  EXPECT_EQ(record[0].pool.wins, 2);
  EXPECT_EQ(record[0].pool.ties, 1);
  EXPECT_EQ(record[1].pool.wins, 3);
  EXPECT_EQ(record[1].scripts.episodes, 2);
}

TEST(LearnLeague, OnlyWhatIsStrongerJoinsThePoolWhereEvidenceIsAskedFor) {
  Games games(with_opponents("pool_size: 4, pool_every_updates: 1, pool_share: 0.4, pool_promotion: evidence"));
  // 12 worlds of a team, 4.8 of them to four policies: worlds 0 to 3 against the pool of team 1, 20 to 23 of team 0.
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{0, 4}, 24}));
  ASSERT_EQ(games.shares.pool(1), (ShardRange{{20, 4}, 24}));
  Simulator& sim = *games.sim;
  std::fill_n(sim.state().view().episode_length, kSmallRunWorlds, 0);  // all games begin with their opponents
  const auto kept = [&] {
    NamedArrays arrays;
    games.league.save("", arrays);
    std::vector<int64_t> count;
    for (const char* team : {"team_0/kept", "team_1/kept"})
      count.push_back(array_values<int64_t>(find_array(arrays, team)).at(0));
    return count;
  };
  const auto play = [&](int64_t update, std::array<float, 4> of_team_0, std::array<float, 4> of_team_1) {
    games.league.begin();
    set_stats(sim, 0, of_team_0);
    set_stats(sim, 20, of_team_1);
    games.league.count(sim);
    sim.take_stats();
    EpisodeStats self_play;
    std::array<LeagueRecord, kNTeams> record;
    games.league.read(self_play, record);
    games.league.end(update, sim);
  };
  play(1, {}, {});
  EXPECT_EQ(kept(), (std::vector<int64_t>{1, 1})) << "the pools were empty";
  // Team 0 wins 7 of 10: 4 more than it loses, and 1.65 sqrt(10) = 5.2 would be evidence. Team 1 wins 9 of 10.
  play(2, {10, 7, 3, 0}, {10, 1, 9, 0});
  EXPECT_EQ(kept(), (std::vector<int64_t>{1, 2}));
  // 14 of 20 together: 8 more, and 1.65 sqrt(20) = 7.4.
  play(3, {10, 7, 3, 0}, {10, 5, 5, 0});
  EXPECT_EQ(kept(), (std::vector<int64_t>{2, 2}));
}

/// Means of a team's figure over the updates of a run in which it is known.
std::array<double, kNTeams> mean_figures(Learner& learner, const std::string& name, int n_updates) {
  std::array<double, kNTeams> sums{};
  std::array<int, kNTeams> counts{};
  for (int u = 0; u < n_updates; ++u) {
    const Metrics metrics = learner.update();
    for (size_t team = 0; team < kNTeams; ++team) {
      const double value = metric(metrics, cat(name, "_", team));
      if (!std::isfinite(value)) continue;
      sums[team] += value;
      ++counts[team];
    }
  }
  for (size_t team = 0; team < kNTeams; ++team) sums[team] /= counts[team];
  return sums;
}

// Where nobody shoots, whoever flies straight on is the first to leave the map, and who circles never does.
TEST(LearnLeague, WinRatesTellStrongOpponentsFromWeakOnes) {
  const auto win_rates = [](const char* script) {
    SmallRun run = with_opponents(cat("scripted_share: 0.8, scripted: [", script, "]"));
    run.scenario =
        "damage: {damage_cone_depth: 0}\ncollision: {collision_range: 0}\nlimit_x: 10\nlimit_y: 10\n"
        "max_episode_length: 120\n";
    run.n_threads = 1;
    const auto learner = run.learner();
    EXPECT_EQ(learner->headline().back().metric, std::string("scripted_win_rate"));
    return mean_figures(*learner, "scripted_win_rate", 40);
  };
  const std::array<double, kNTeams> weak = win_rates("noop"), strong = win_rates("circle");
  for (size_t team = 0; team < kNTeams; ++team) {
    EXPECT_GT(weak[team], 0.3) << "team " << team;
    EXPECT_LT(strong[team], 0.1) << "team " << team;
  }
}

TEST(LearnLeague, WinRatesAgainstThePoolAreLogged) {
  // Episodes of at most 40 steps, rollouts of 8: those that begin and end between two draws count.
  const auto learner = with_opponents("pool_size: 2, pool_every_updates: 12, pool_share: 0.8").learner();
  EXPECT_TRUE(std::isnan(mean_figures(*learner, "pool_win_rate", 12)[0])) << "nothing counts while the pool is empty";
  for (const double rate : mean_figures(*learner, "pool_win_rate", 24)) {
    EXPECT_GT(rate, 0.05);
    EXPECT_LT(rate, 0.95);
  }
}

// A waypoint covers half of the world: team 0, in the middle, is in nearly every one, team 1, at the border, in one of
// fifty, and nobody dies or gets to another place. In 14 % of the episodes no waypoint appears (0.95^39).
TEST(LearnLeague, WhereWaypointsDecideTheRecordOfThePoolGoesByThem) {
  const auto play = [](const std::string& win) {
    SmallRun run = with_opponents("pool_size: 2, pool_every_updates: 12, pool_share: 0.8, pool_draw: pfsp");
    run.n_threads = 1;
    run.scenario =
        cat("limit_x: 2000\nlimit_y: 1000\nmaps: m\nmap_definitions:\n"
            "  m: {size: [2000, 1000], team_0: {area: [995, 495, 1005, 505]}, team_1: {area: [20, 495, 30, 505]}}\n"
            "team_0: [{type: default, count: 1}]\nteam_1: [{type: default, count: 1}]\n"
            "waypoints: {enable_waypoints: true, waypoint_size: 1000}\nwin: {by: ",
            win, "}\n");
    return run.learner();
  };
  // What a team has won of its games against the other's past policies, ties being half a win; as PFSP looks at it.
  const auto pool_record = [](const Learner& learner, int team) {
    const NamedArrays arrays = saved(learner);
    const auto sum = [&](const char* name) {
      double total = 0;
      for (const double x : array_values<double>(find_array(arrays, cat("league/team_", 1 - team, "/", name))))
        total += x;
      return total;
    };
    EXPECT_GT(sum("games"), 0);
    return sum("wins") / sum("games");
  };
  const auto race = play("waypoints"), survival = play("elimination");
  const std::array<double, kNTeams> rates = mean_figures(*race, "pool_win_rate", 24);
  EXPECT_GT(rates[0], 0.6);
  EXPECT_LT(rates[1], 0.1);
  EXPECT_GT(pool_record(*race, 0), 0.7);
  EXPECT_LT(pool_record(*race, 1), 0.3);
  for (const double rate : mean_figures(*survival, "pool_win_rate", 24)) EXPECT_EQ(rate, 0);
  EXPECT_EQ(pool_record(*survival, 0), 0.5) << "ties";
}

TEST(LearnLeague, ARunGoesOnWithOtherShares) {
  SmallRun run = with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.2");
  const auto learner = run.learner();
  for (int u = 0; u < 3; ++u) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  run.more = "opponents: {pool_size: 3, pool_every_updates: 1, pool_share: 0.8, scripted_share: 0.1}\n";
  const auto other = run.learner();
  other->load(checkpoint);
  expect_finite(other->update(), 0);
  NamedArrays broken = checkpoint;
  for (NamedArray& array : broken)
    if (array.name == "league/team_1/row") array = make_array<int32_t>(array.name, {0, 4, 1});
  EXPECT_THROW(other->load(broken), InputError);  // row 4 of a pool of three
}

}  // namespace
}  // namespace giga::test
