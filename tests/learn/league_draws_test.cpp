// Mappo with past policies: a game that is on when opponents are drawn is finished against the one that it began with.
#include <gtest/gtest.h>

#include <set>

#include "fused_cases.hpp"
#include "league_games.hpp"
#include "learn/libtorch_settings.hpp"
#include "math/earlier_opponent.hpp"

namespace giga::test {
namespace {

/// Nobody can die or leave the map, so that all games have the same number of steps.
std::string games_of(int steps) {
  return cat("damage: {damage_cone_depth: 0}\ncollision: {collision_range: 0}\nlimit_x: 1000\nlimit_y: 1000\n",
             "max_episode_length: ", steps, "\n");
}

/// As an update ends: counts, and draws if `update` calls for it.
std::array<LeagueRecord, kNTeams> end_update(LeagueGames& games, int64_t update) {
  games.league.count(*games.sim);
  games.sim->take_stats();
  EpisodeStats self_play;
  std::array<LeagueRecord, kNTeams> record;
  games.league.read(self_play, record);
  games.league.end(update, *games.sim);
  return record;
}

/// Both teams always take this action from now on: by a bias of the last layer towards it; a mean far from 0 where
/// actions are continuous.
void always(LeagueGames& games, int action) {
  at::NoGradGuard no_grad;
  for (PpoTeam& team : games.team) {
    const Actor& actor = team.actor();
    const at::Tensor& values = actor.parameters().values();
    values.zero_();
    const int64_t bias = actor.fused_mlp().value().bias[2];
    if (actor.actions() == ActionKind::discrete)
      values[bias + action] = 100;
    else
      values.narrow(0, bias, kActionSize).fill_(action == 0 ? -20 : 20);
  }
}

/// What the opponents of `learner` do in each step of the rollout: the discrete action, or 1 where continuous ones are
/// above 0; -1 where they do not all do the same.
std::vector<int> actions_against(const LeagueGames& games, int learner) {
  const at::Tensor action = games.collector.rollout().team[1 - learner].action;
  const bool discrete = action.scalar_type() == at::kInt;
  std::vector<int> taken;
  for (int64_t t = 0; t < action.size(0); ++t) {
    const WorldRange pool = games.shares.pool(learner).in_shard;
    const at::Tensor a = action[t].narrow(0, pool.first, pool.count);
    const at::Tensor numbers = discrete ? a : (a > 0).to(at::kInt);
    const int first = numbers.flatten()[0].item<int>();
    taken.push_back((numbers == first).all().item<bool>() ? first : -1);
  }
  return taken;
}

// Games of 12 steps, rollouts of 8, a pool of one policy.
TEST(LearnLeagueDraws, AGameIsFinishedAgainstTheOpponentThatItBeganWith) {
  for (const char* way : {"fused: true", "fused: false"})
    for (const char* actions : {"discrete", "continuous"}) {
      SCOPED_TRACE(cat(way, ", ", actions));
      SmallRun small = with_opponents("pool_size: 1, pool_every_updates: 1, pool_share: 0.5");
      small.mappo = way;
      small.scenario = cat(games_of(12), "action: ", actions, "\n");
      LeagueGames games(small);
      const auto expect = [&](const std::vector<int>& expected) {
        games.collect();
        for (int learner = 0; learner < 2; ++learner) EXPECT_EQ(actions_against(games, learner), expected) << learner;
      };
      always(games, 0);
      end_update(games, 1);
      always(games, 1);  // nobody meets the teams as they are once the pool has somebody
      expect({0, 0, 0, 0, 0, 0, 0, 0});
      end_update(games, 2);  // after 8 steps of a game
      expect({0, 0, 0, 0, 1, 1, 1, 1});
      always(games, 0);
      end_update(games, 3);  // after 4 of the next
      expect({1, 1, 1, 1, 1, 1, 1, 1});
      always(games, 1);
      end_update(games, 4);  // as a game begins: against the latest policy at once
      expect({1, 1, 1, 1, 1, 1, 1, 1});
    }
}

// Games of 20 steps: those that were on at the draw after step 8 still are at the turn after step 16.
TEST(LearnLeagueDraws, AGroupWhoseEarlierOpponentStillPlaysWaits) {
  SmallRun small = with_opponents("pool_size: 1, pool_every_updates: 1, pool_share: 0.5");
  small.scenario = games_of(20);
  LeagueGames games(small);
  const auto expect = [&](const std::vector<int>& expected) {
    games.collect();
    for (int learner = 0; learner < 2; ++learner) EXPECT_EQ(actions_against(games, learner), expected) << learner;
  };
  const auto of_team_1 = [&](const char* name) {
    NamedArrays arrays;
    games.league.save("", arrays);
    return find_array(arrays, cat("team_1/", name));
  };
  always(games, 1);
  end_update(games, 1);
  expect({1, 1, 1, 1, 1, 1, 1, 1});
  always(games, 2);
  end_update(games, 2);
  expect({1, 1, 1, 1, 1, 1, 1, 1});
  always(games, 3);
  end_update(games, 3);  // 3 takes the place of 2 in the pool; 2 is met all the same, since 1 still plays
  EXPECT_EQ(array_values<int32_t>(of_team_1("row")), std::vector<int32_t>{-1});
  expect({1, 1, 1, 1, 2, 2, 2, 2});
  always(games, 4);
  end_update(games, 4);  // after 4 steps against 2
  EXPECT_EQ(array_values<int32_t>(of_team_1("row")), std::vector<int32_t>{1});
  expect({2, 2, 2, 2, 2, 2, 2, 2});
  expect({2, 2, 2, 2, 2, 2, 2, 2});
  end_update(games, 5);  // as the game ends: 4 again, the team's latest policy; nobody has yet played it
  expect({4, 4, 4, 4, 4, 4, 4, 4});
}

// Three groups of two worlds; of the last one a world still plays its earlier opponent.
TEST(LearnLeagueDraws, OnlyThatGroupWaits) {
  LeagueGames games(with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.5"));
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{0, 6}, 24}));
  int32_t* const length = games.sim->state().view().episode_length;
  const auto first_of = [](const LeagueGames& of, const char* name) {
    NamedArrays arrays;
    of.league.save("", arrays);
    of.league.save_worlds("", arrays);
    const NamedArray& array = find_array(arrays, name);
    at::Tensor x = at::empty(array.shape, array.type == ArrayType::f32   ? at::kFloat
                                          : array.type == ArrayType::i32 ? at::kInt
                                                                         : at::kByte);
    from_array(array, x);
    return x;
  };
  std::fill_n(length, kSmallRunWorlds, 5);
  const at::Tensor initial = first_of(games, "team_1/met")[0];
  always(games, 1);
  end_update(games, 1);
  const at::Tensor one = first_of(games, "team_1/met"), drawn = first_of(games, "drawn_at");
  EXPECT_FALSE(at::equal(one[0], initial));
  EXPECT_TRUE(at::equal(one[1], initial));

  for (int w = 0; w < 5; ++w) length[w] = 0;
  always(games, 2);
  for (int w = 0; w < kSmallRunWorlds; ++w) games.sim->state().view().draw_step[w] += 3;
  end_update(games, 2);
  const at::Tensor two = first_of(games, "team_1/met"), then = first_of(games, "drawn_at");
  EXPECT_TRUE(at::equal(two[1].narrow(0, 0, 2), one[0].narrow(0, 0, 2))) << "what they played is their earlier one";
  EXPECT_TRUE(at::equal(two.narrow(1, 2, 1), one.narrow(1, 2, 1))) << "the last group has whom it had";
  const at::Tensor apart = (then - drawn).narrow(0, 0, 6);
  EXPECT_TRUE(at::equal(apart.narrow(0, 0, 4), at::full({4}, 3, at::kInt)));
  EXPECT_EQ(apart[5].item<int>(), 0);
  // Games that begin at the draw count; that of the last world does not.
  EXPECT_TRUE(at::equal(first_of(games, "counts").narrow(0, 0, 4), at::ones({4}, at::kByte)));
  EXPECT_EQ(first_of(games, "counts")[5].item<int>(), 0);
}

// A group of three worlds, of which one goes on and on against its first opponent. The second one, which the others
// meet meanwhile, leaves the pool of one policy at the second turn: what they win counts, but is nobody's record.
TEST(LearnLeagueDraws, WhoHasLeftThePoolPlaysOnWithoutARecord) {
  LeagueGames games(with_opponents("pool_size: 1, pool_every_updates: 1, pool_share: 0.25"));
  ASSERT_EQ(games.shares.pool(0), (ShardRange{{0, 3}, 24}));
  const StateView& state = games.sim->state().view();
  std::fill_n(state.episode_length, kSmallRunWorlds, 5);
  end_update(games, 1);
  state.episode_length[0] = state.episode_length[1] = 0;
  const auto record_of = [&] {
    NamedArrays arrays;
    games.league.save("", arrays);
    return array_values<double>(find_array(arrays, "team_1/games"));
  };
  set_stats(*games.sim, 0, {1, 1, 0, 0});  // began before the first draw
  EXPECT_EQ(end_update(games, 2)[0].pool.episodes, 0);
  EXPECT_EQ(record_of(), std::vector<double>{0});
  set_stats(*games.sim, 0, {1, 1, 0, 0});
  set_stats(*games.sim, 2, {1, 1, 0, 0});  // the one that went on
  EXPECT_EQ(end_update(games, 3)[0].pool.episodes, 1);
  EXPECT_EQ(record_of(), std::vector<double>{0});
}

// One rank's group still plays its earlier opponents: all ranks keep theirs, and draw alike.
TEST(LearnLeagueDraws, AGroupWaitsForAllRanks) {
  const SmallRun small = with_opponents("pool_size: 3, pool_every_updates: 1, pool_share: 0.5");
  std::array<at::Tensor, 2> sums;  // of each rank
  const auto rank = [&](size_t k) {
    return std::make_unique<LeagueGames>(small, 1, SumOverRanks{[&sums, k](const at::Tensor& x, void*) {
                                           sums[k] = x.clone();
                                           if (sums[1 - k].defined()) x.add_(sums[1 - k]);
                                         }});
  };
  const std::array<std::unique_ptr<LeagueGames>, 2> ranks = {rank(0), rank(1)};
  const auto end_updates = [&](int64_t update) {
    sums = {};
    for (const auto& games : ranks) games->league.count(*games->sim);  // the second time each knows the other's
    for (const auto& games : ranks) end_update(*games, update);
  };
  const auto rows = [&](size_t k) {
    NamedArrays arrays;
    ranks[k]->league.save("", arrays);
    return array_values<int32_t>(find_array(arrays, "team_1/row"));
  };
  for (const auto& games : ranks) std::fill_n(games->sim->state().view().episode_length, kSmallRunWorlds, 5);
  end_updates(1);
  EXPECT_EQ(rows(0), (std::vector<int32_t>{1, 1, 1}));
  // The second rank's games against the first group go on; all others begin.
  for (size_t k = 0; k < 2; ++k)
    for (int w = k == 1 ? 2 : 0; w < kSmallRunWorlds; ++w) ranks[k]->sim->state().view().episode_length[w] = 0;
  std::set<int32_t> first, others;
  for (int64_t update = 2; update < 8; ++update) {
    end_updates(update);
    const std::vector<int32_t> now = rows(0);
    EXPECT_EQ(now, rows(1)) << update;
    first.insert(now[0]);
    others.insert(now.begin() + 1, now.end());
  }
  EXPECT_TRUE(first == std::set<int32_t>{1} || first == (std::set<int32_t>{-1, 1})) << "the first group waits";
  EXPECT_GT(others.size(), 1u);
}

/// What both teams do in six rollouts of 8 steps, and what they remember after each; `drawn_after` one of them the pool
/// of a run with games of 24 steps gets another policy, and opponents are drawn.
std::vector<at::Tensor> played(const SmallRun& small, int drawn_after, Device device) {
  at::NoGradGuard no_grad;
  LeagueGames games(small, 1, {}, device);
  end_update(games, 1);
  std::vector<at::Tensor> all;
  for (int k = 1; k <= 6; ++k) {
    games.collect();
    if (k == drawn_after) {  // the learners go on as they are
      std::array<at::Tensor, kNTeams> kept;
      for (size_t team = 0; team < kNTeams; ++team) {
        const at::Tensor& values = games.team[team].actor().parameters().values();
        kept[team] = values.clone();
        values.mul_(-1);
      }
      end_update(games, 2);
      for (size_t team = 0; team < kNTeams; ++team) games.team[team].actor().parameters().values().copy_(kept[team]);
    }
    for (const TeamRollout& r : games.collector.rollout().team) all.push_back(r.action.cpu().clone());
    NamedArrays memory;
    games.collector.save("", memory);
    for (const NamedArray& array : memory) {
      all.push_back(at::empty(array.shape));
      from_array(array, all.back());
    }
  }
  return all;
}

/// A draw after 16 steps and one after 24 come to the same, to the last bit: the opponents act and remember until the
/// end of the game as if nobody had been drawn, and begin the next one as the new ones.
void expect_draws_at_ends_of_games(Device device) {
  struct Case {
    const char *mappo, *actor, *scenario;
  };
  for (const auto& [mappo, actor, scenario] :
       {Case{"fused: true", "hidden: [16, 16]", ""},
        {"fused: false", "hidden: [16, 16]", ""},
        {"obs_norm: true", "hidden: [16, 16]", "action: continuous\n"},
        {"obs_norm: true, fused: false", "hidden: [16]", "action: continuous\n"},
        {"", "hidden: [16], memory: gru, memory_size: 6", ""},
        {"", "hidden: [16], memory: lstm, memory_size: 6", "action: continuous\n"}}) {
    SCOPED_TRACE(cat(mappo, ", ", actor, ", ", scenario));
    SmallRun small = with_opponents("pool_size: 2, pool_every_updates: 1, pool_share: 0.5");
    small.mappo = mappo;
    small.actor = actor;
    small.scenario = cat(games_of(24), scenario);
    if (device.is_cuda()) small.precision = "tf32";
    set_up_libtorch(small.load().config.train, device);
    const std::vector<at::Tensor> midway = played(small, 2, device), at_the_end = played(small, 3, device),
                                  never = played(small, 0, device);
    ASSERT_EQ(midway.size(), at_the_end.size());
    for (size_t k = 0; k < midway.size(); ++k) EXPECT_TRUE(at::equal(midway[k], at_the_end[k])) << k;
    const size_t ended = midway.size() / 2;  // after three rollouts
    EXPECT_TRUE(at::equal(midway[ended - 1], never[ended - 1]));
    EXPECT_FALSE(at::equal(midway[ended], never[ended]) && at::equal(midway[ended + 1], never[ended + 1]))
        << "somebody else was drawn";
  }
}

TEST(LearnLeagueDraws, ADrawMattersWhereGamesEnd) { expect_draws_at_ends_of_games(kCpu); }
// There the plays are recorded from the second one on.
TEST(LearnLeagueDrawsGpu, ADrawMattersWhereGamesEnd) {
  if (const std::string why = no_fused_kernels(); !why.empty()) GTEST_SKIP() << why;
  expect_draws_at_ends_of_games(kOneGpu);
}

/// Games of the pool's share that go on against earlier opponents.
int64_t earlier_games(const NamedArrays& arrays) {
  const auto length = array_values<int32_t>(find_array(arrays, "simulator/episode_length"));
  const auto step = array_values<int32_t>(find_array(arrays, "simulator/draw_step"));
  const auto drawn_at = array_values<int32_t>(find_array(arrays, "league/drawn_at"));
  int64_t n = 0;
  for (size_t w = 0; w < length.size(); ++w)
    n += began_before(length[w], static_cast<uint32_t>(step[w]), static_cast<uint32_t>(drawn_at[w]));
  return n;
}

SmallRun with_long_games(const std::string& actor) {
  SmallRun run = with_opponents("pool_size: 2, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp");
  run.scenario = games_of(40);
  run.actor = actor;
  return run;
}

TEST(LearnLeagueDraws, ARunGoesOnExactlyAmidGamesAgainstEarlierOpponents) {
  for (const char* actor : {"hidden: [16, 16]", "hidden: [16], memory: lstm, memory_size: 6"}) {
    const SmallRun run = with_long_games(actor);
    const auto learner = run.learner(), other = run.learner();
    for (int u = 0; u < 5; ++u) learner->update();
    other->update();
    const NamedArrays checkpoint = saved(*learner);
    EXPECT_GT(earlier_games(checkpoint), 2);
    other->load(checkpoint);
    EXPECT_EQ(difference(saved(*other), checkpoint), "");
    for (int u = 0; u < 6; ++u) {
      const Metrics expected = learner->update(), actual = other->update();
      EXPECT_EQ(difference(expected, actual), "") << "update " << u << " after loading";
      ASSERT_EQ(difference(saved(*learner), saved(*other)), "") << "update " << u << " after loading";
    }
  }
}

// Those of before there were two generations hold neither the networks that are met nor when they were drawn.
TEST(LearnLeagueDraws, OlderCheckpointsHaveNoEarlierOpponents) {
  const SmallRun run = with_long_games("hidden: [16, 16]");
  const auto learner = run.learner();
  for (int u = 0; u < 5; ++u) learner->update();
  const NamedArrays checkpoint = saved(*learner);
  NamedArrays older;
  for (const NamedArray& array : checkpoint)
    if (array.name != "league/drawn_at" && !array.name.ends_with("/met")) older.push_back(array);
  ASSERT_EQ(older.size() + 3, checkpoint.size());
  const auto other = run.learner();
  other->load(older);
  const NamedArrays loaded = saved(*other);
  EXPECT_EQ(earlier_games(loaded), 0);
  for (const char* name : {"league/team_0/row", "league/team_1/networks", "league/counts"})
    EXPECT_EQ(find_array(loaded, name).bytes, find_array(checkpoint, name).bytes) << name;
  // The networks that are met are those of the rows.
  const auto rows = array_values<int32_t>(find_array(loaded, "league/team_0/row"));
  const auto pool = array_values<float>(find_array(loaded, "league/team_0/networks"));
  const auto met = array_values<float>(find_array(loaded, "league/team_0/met"));
  const size_t size = pool.size() / 2;
  for (size_t g = 0; g < rows.size(); ++g) {
    ASSERT_GE(rows[g], 1);
    EXPECT_TRUE(std::equal(met.begin() + static_cast<std::ptrdiff_t>(g * size),
                           met.begin() + static_cast<std::ptrdiff_t>((g + 1) * size),
                           pool.begin() + static_cast<std::ptrdiff_t>(static_cast<size_t>(rows[g] - 1) * size)));
  }
  for (int u = 0; u < 3; ++u) expect_finite(other->update(), 0);
  // It says so or it does not: a part of it is damaged.
  for (const char* name : {"league/drawn_at", "league/team_0/met", "league/team_1/met"}) {
    NamedArrays half = checkpoint;
    std::erase_if(half, [&](const NamedArray& array) { return array.name == name; });
    EXPECT_THROW(other->load(half), InputError) << name;
  }
}

}  // namespace
}  // namespace giga::test
