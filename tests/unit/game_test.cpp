// Game: who is asked for actions, what observers get, when a game is over, and what is written for whom.
#include "game/game.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "game_spec.hpp"
#include "sim/observations.hpp"

namespace giga::test {
namespace {

std::unique_ptr<Simulator> simulator(const SimSpec& spec, OnDone on_done = OnDone::reset, int64_t first_world = 0) {
  SimOptions options;
  options.first_world = first_world;
  options.n_worlds = kWorlds;
  options.seed = 5;
  options.on_done = on_done;
  options.n_threads = 2;
  return make_cpu_simulator(spec, options);
}

/// Flies straight on, and notes what it was asked for.
class Straight final : public TeamController {
 public:
  explicit Straight(ObservationSet reads = {}) : reads_(reads) {}

  ObservationSet reads() const override { return reads_; }
  void act(std::span<const TeamStep> parts) override {
    std::string asked = cat("step ", parts[0].number, ":");
    for (const TeamStep& part : parts) {
      asked += cat(" team ", part.team, " worlds ", part.worlds.first, "-", part.worlds.end());
      for (int64_t row = 0; row < part.n_rows(); ++row) static_cast<int32_t*>(part.buffers.action)[row] = 13;
      obs[part.team] = part.buffers.obs;
    }
    calls.push_back(asked);
  }

  std::vector<std::string> calls;
  const float* obs[kNTeams] = {};

 private:
  const ObservationSet reads_;
};

/// Counts, and wants the ends of episodes and the actions where asked to.
class Witness final : public GameObserver {
 public:
  explicit Witness(bool wants = false) : wants_(wants) {}

  void before_play(int64_t n_steps) override { plays.push_back(n_steps); }
  void before_step(int64_t, GameStep& step) override {
    if (!wants_) return;
    step.io.done = done.data();
    step.team[1].action = action.data();
  }
  void after_step(int64_t t, const GameStep& step) override {
    after.push_back(t);
    last = step;
  }

  std::vector<int64_t> plays, after;
  std::vector<uint8_t> done = std::vector<uint8_t>(kWorlds, 99);
  std::vector<int32_t> action = std::vector<int32_t>(kWorlds * 2, 99);
  GameStep last;

 private:
  const bool wants_;
};

/// Wants ends of episodes, rewards of team 0, and observations, for which it has no buffer.
class Watcher final : public GameObserver {
 public:
  explicit Watcher(ObservationSet looks) : looks_(looks) {}

  void before_step(int64_t, GameStep& step) override {
    want(step.io.done, done.data());
    want(step.io.team[0].reward, reward.data());
    step.rows[0].wanted |= looks_;
  }
  void after_step(int64_t, const GameStep& step) override {
    last = step;
    ++seen;
  }

  std::vector<uint8_t> done = std::vector<uint8_t>(kWorlds, 99);
  std::vector<float> reward = std::vector<float>(kWorlds * 3, 99);
  GameStep last;
  int seen = 0;

 private:
  const ObservationSet looks_;
};

TEST(Game, EachControllerIsAskedOnceAStepForAllItsParts) {
  const auto sim = simulator(game_spec());
  const auto a = std::make_shared<Straight>(), b = std::make_shared<Straight>();
  Game game(*sim, parallel_for(), {Side{{a, {0, 3}}, {b, {3, 4}}}, Side{{b, {0, 2}}, {a, {2, 5}}}});
  game.start();
  game.play(1);
  game.play(1);
  EXPECT_EQ(a->calls, (std::vector<std::string>{"step 0: team 0 worlds 0-3 team 1 worlds 2-7",
                                                "step 1: team 0 worlds 0-3 team 1 worlds 2-7"}));
  EXPECT_EQ(b->calls[1], "step 1: team 0 worlds 3-7 team 1 worlds 0-2");
  game.start();
  game.play(1);
  EXPECT_EQ(a->calls.back().substr(0, 7), "step 0:");
}

TEST(Game, PartsOfATeamActAsOneControllerDoes) {
  const SimSpec spec = game_spec();
  const auto play = [&](const Side& side0) {
    const auto sim = simulator(spec);
    Game game(*sim, parallel_for(), {side0, everywhere(script_controller(Scripted::circle_random), *sim)});
    game.start();
    game.play(50);
    return sim->state().save();
  };
  const auto script = [](Scripted kind) { return std::shared_ptr<TeamController>(script_controller(kind)); };
  for (const Scripted kind : {Scripted::random, Scripted::circle_random, Scripted::pursuer})
    EXPECT_EQ(play({{script(kind), {0, 7}}}), play({{script(kind), {0, 2}}, {script(kind), {2, 5}}})) << name_of(kind);
}

TEST(Game, APlayInPiecesIsTheSame) {
  const SimSpec spec = game_spec();
  const auto play = [&](const std::vector<int64_t>& pieces) {
    const auto sim = simulator(spec);
    Game game(*sim, parallel_for(),
              {everywhere(script_controller(Scripted::pursuer), *sim),
               everywhere(script_controller(Scripted::random), *sim)});
    game.start();
    for (const int64_t n : pieces) game.play(n);
    return sim->state().save();
  };
  EXPECT_EQ(play({40}), play({1, 30, 9}));
}

TEST(Game, ObserversGetEachStepAndBringTheirBuffers) {
  const auto sim = simulator(game_spec());
  const auto straight = std::make_shared<Straight>();
  Witness first, second(true);
  Game game(*sim, parallel_for(), {everywhere(straight, *sim), everywhere(straight, *sim)}, {&first, &second});
  game.start();
  game.play(30);
  std::vector<int64_t> numbers;
  for (int64_t t = -1; t < 30; ++t) numbers.push_back(t);
  EXPECT_EQ(first.after, numbers);
  EXPECT_EQ(first.plays, std::vector<int64_t>{30});
  EXPECT_EQ(second.action, std::vector<int32_t>(kWorlds * 2, 13));
  EXPECT_EQ(second.last.io.team[1].action, second.action.data());
  EXPECT_EQ(second.last.rows[0].obs, nullptr) << "nobody looks";
  for (const uint8_t done : second.done) EXPECT_LE(done, 2);
}

TEST(Game, ObserversThatWantTheSameShareIt) {
  const SimSpec spec = game_spec(true);
  const RowLayout layout = observation_rows(spec);
  const auto sim = simulator(spec);
  const auto straight = std::make_shared<Straight>();
  Watcher first(Observation::vector), second(Observation::egocentric), late(Observation::vector);
  Game game(*sim, parallel_for(), {everywhere(straight, *sim), everywhere(straight, *sim)}, {&first, &second});
  game.start();
  game.play(2);
  EXPECT_EQ(first.last.io.done, first.done.data());
  EXPECT_EQ(second.last.io.done, first.done.data());
  EXPECT_EQ(second.last.io.team[0].reward, first.reward.data());
  for (const uint8_t done : first.done) EXPECT_LE(done, 2);
  const float* row = second.last.rows[0].obs;
  ASSERT_NE(row, nullptr) << "the game has a buffer";
  for (const Observation kind : {Observation::vector, Observation::egocentric}) {
    const RowLayout::Columns columns = layout.columns(kind);
    EXPECT_TRUE(std::any_of(row + columns.first, row + columns.first + columns.count, [](float x) { return x != 0; }));
  }
  EXPECT_EQ(second.last.rows[1].obs, nullptr) << "nobody wants those of team 1";

  game.watch(late);
  game.play(3);
  EXPECT_EQ(late.seen, 3);
  EXPECT_EQ(first.seen, 6) << "the start and five steps";
}

TEST(Game, IsOverWhenAllWorldsWait) {
  const auto sim = simulator(game_spec(), OnDone::freeze);
  const auto straight = std::make_shared<Straight>();
  Witness witness;
  Game game(*sim, parallel_for(), {everywhere(straight, *sim), everywhere(straight, *sim)}, {&witness});
  game.start();
  game.play(1000);
  // The time limit is 30 steps; whether all wait is looked at every eighth step.
  EXPECT_LE(witness.after.back(), 31);
  EXPECT_EQ(sim->take_stats()[EpisodeStat::episodes], kWorlds);
  game.start();
  game.play(1);
  EXPECT_EQ(witness.after.back(), 0) << "a new start plays again";
}

TEST(Game, WritesTheObservationsThatControllersRead) {
  const SimSpec spec = game_spec(true);
  const RowLayout layout = observation_rows(spec);
  const auto sum_of = [&](const float* row, Observation kind) {
    double sum = 0;
    const RowLayout::Columns columns = layout.columns(kind);
    for (int64_t k = 0; k < columns.count; ++k) sum += std::abs(static_cast<double>(row[columns.first + k]));
    return sum;
  };
  for (const ObservationSet other : {ObservationSet(), ObservationSet(Observation::egocentric), layout.set()}) {
    const auto sim = simulator(spec);
    const auto looking = std::make_shared<Straight>(Observation::egocentric),
               opponent = std::make_shared<Straight>(other);
    Game game(*sim, parallel_for(), {everywhere(looking, *sim), everywhere(opponent, *sim)});
    game.start();
    game.play(2);
    ASSERT_NE(looking->obs[0], nullptr);
    EXPECT_EQ(sum_of(looking->obs[0], Observation::vector), 0);
    EXPECT_GT(sum_of(looking->obs[0], Observation::egocentric), 0);
    ASSERT_EQ(opponent->obs[1] == nullptr, other.empty());
    if (other.empty()) continue;
    EXPECT_EQ(sum_of(opponent->obs[1], Observation::vector) > 0, other.has(Observation::vector));
    EXPECT_GT(sum_of(opponent->obs[1], Observation::egocentric), 0);
  }
}

// Two players of team 0 read different observations, each in its worlds. An observer's are written in all worlds, and
// what is read where was told before it came.
TEST(Game, WritesRowsWhereSomebodyReadsThem) {
  const SimSpec spec = game_spec(true);
  const auto sim = simulator(spec);
  const auto numbers = std::make_shared<Straight>(Observation::vector),
             looking = std::make_shared<Straight>(Observation::egocentric);
  Witness witness;
  Game game(*sim, parallel_for(), {Side{{numbers, {0, 3}}, {looking, {3, 4}}}, everywhere(numbers, *sim)}, {&witness});
  const auto sets_of = [&](int team) {
    const uint8_t* reads = witness.last.io.team[team].reads;
    return reads ? std::vector<int>(reads, reads + kWorlds) : std::vector<int>();
  };
  game.start();
  game.play(2);
  EXPECT_EQ(sets_of(0), (std::vector<int>{1, 1, 1, 2, 2, 2, 2})) << "bit 0: the vector, bit 1: the view";
  EXPECT_EQ(sets_of(1), std::vector<int>()) << "alike in all worlds";
  const RowLayout layout = observation_rows(spec);
  const auto is_written = [&](int world, Observation kind) {
    const RowLayout::Columns columns = layout.columns(kind);
    const float* row = witness.last.rows[0].obs + static_cast<int64_t>(world) * 3 * layout.stride() + columns.first;
    return std::any_of(row, row + columns.count, [](float x) { return x != 0; });
  };
  for (int w = 0; w < kWorlds; ++w) {
    EXPECT_EQ(is_written(w, Observation::vector), w < 3) << w;
    EXPECT_EQ(is_written(w, Observation::egocentric), w >= 3) << w;
  }
  Watcher watcher(Observation::egocentric);
  game.watch(watcher);
  game.play(1);
  EXPECT_EQ(sets_of(0), std::vector<int>()) << "all that has rows is written";
  game.start();
  game.play(1);
  EXPECT_EQ(sets_of(0), (std::vector<int>{3, 3, 3, 2, 2, 2, 2}));
}

// Team 0 in worlds 1, 3, 5, team 1 in 2, 3, 6: but not who reads the vector, as scripts do, or both.
TEST(Game, NetworksOfTheViewAlonePlayInTheMirrorInHalfOfTheWorlds) {
  const SimSpec spec = game_spec(true);
  const auto sim = simulator(spec);
  const auto looking = std::make_shared<Straight>(Observation::egocentric),
             script = std::make_shared<Straight>(Observation::vector),
             both = std::make_shared<Straight>(observation_rows(spec).set());
  const auto mirrored = [&](const Side& side_0, const Side& side_1, bool mirror) {
    Witness witness;
    Game game(*sim, parallel_for(), {side_0, side_1}, {&witness});
    if (mirror) game.mirror_half();
    game.start();
    game.play(1);
    std::array<std::vector<int>, kNTeams> worlds;
    for (size_t team = 0; team < kNTeams; ++team)
      if (const uint8_t* m = witness.last.io.team[team].mirrored) worlds[team].assign(m, m + kWorlds);
    return worlds;
  };
  using Worlds = std::vector<int>;
  EXPECT_EQ(mirrored(everywhere(looking, *sim), everywhere(looking, *sim), true),
            (std::array<Worlds, 2>{Worlds{0, 1, 0, 1, 0, 1, 0}, Worlds{0, 0, 1, 1, 0, 0, 1}}));
  EXPECT_EQ(mirrored({{script, {0, 2}}, {looking, {2, 5}}}, {{both, {0, 3}}, {looking, {3, 4}}}, true),
            (std::array<Worlds, 2>{Worlds{0, 0, 0, 1, 0, 1, 0}, Worlds{0, 0, 0, 1, 0, 0, 1}}));
  EXPECT_EQ(mirrored(everywhere(looking, *sim), everywhere(looking, *sim), false), (std::array<Worlds, 2>{}));
  // Of a rank whose first world is number 3 of all, and where a game goes on.
  const auto later = simulator(spec, OnDone::reset, 3);
  Witness witness;
  Game game(*later, parallel_for(), {everywhere(looking, *later), everywhere(looking, *later)}, {&witness});
  game.mirror_half();
  game.resume();
  game.play(1);
  const uint8_t* first = witness.last.io.team[0].mirrored;
  EXPECT_EQ(Worlds(first, first + kWorlds), (Worlds{1, 0, 1, 0, 1, 0, 1}));
}

TEST(Game, SomebodyMovesEveryWorldOnce) {
  const auto sim = simulator(game_spec());
  const auto straight = std::make_shared<Straight>();
  const auto with = [&](const Side& side) { Game(*sim, parallel_for(), {side, everywhere(straight, *sim)}); };
  EXPECT_NO_THROW(with({{straight, {0, 3}}, {straight, {3, 4}}}));
  EXPECT_THROW(with({{straight, {0, 3}}}), Error);
  EXPECT_THROW(with({{straight, {0, 3}}, {straight, {2, 5}}}), Error);
  EXPECT_THROW(with({{straight, {0, 3}}, {straight, {4, 3}}}), Error);
  EXPECT_THROW(with({}), Error);
}

TEST(Game, NeedsAStart) {
  const auto sim = simulator(game_spec());
  const auto straight = std::make_shared<Straight>();
  Game game(*sim, parallel_for(), {everywhere(straight, *sim), everywhere(straight, *sim)});
  EXPECT_THROW(game.play(1), Error);
}

}  // namespace
}  // namespace giga::test
