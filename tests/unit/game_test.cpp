// Game: who is asked for actions, what observers get, when a game is over, and what is written for whom.
#include "game/game.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/observations.hpp"
#include "sim/step.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

constexpr int kWorlds = 7;

SimSpec game_spec(bool egocentric_view = false) {
  SimSpec spec = plain_spec(3, 2);
  spec.params.actions = ActionKind::discrete;
  spec.params.egocentric_view = egocentric_view;
  spec.params.max_episode_length = 30;
  spec.finish();
  return spec;
}

std::unique_ptr<Simulator> simulator(const SimSpec& spec, OnDone on_done = OnDone::reset) {
  SimOptions options;
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

const ParallelFor& parallel_for() {
  static const ParallelFor loop(Device{}, 1);
  return loop;
}

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

/// What a device would have queued, where it is recorded; else it is done at once.
struct Tape {
  using Work = std::vector<std::function<void()>>;
  Work* records_to = nullptr;
  void queue(std::function<void()> f) const {
    if (!records_to) return f();
    records_to->push_back(std::move(f));
  }
};

/// Records as a GPU does, and hears as late as one that all worlds wait.
class RecordingSimulator final : public Simulator {
 public:
  RecordingSimulator(const SimSpec& spec, const SimOptions& options, Tape& tape)
      : Simulator(spec, options, host_memory()),
        tape_(tape),
        layout_(params()),
        scratch_(host_memory(), layout_.size) {}

  void redraw(const Redraw&) override {}
  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }
  bool over() override { return n_lists() > 2 && counts_[static_cast<size_t>(n_lists()) - 3] == 0; }
  std::unique_ptr<RecordedWork> record(size_t most_beside, const std::function<void(Recording&)>& work) override {
    ++n_recorded;
    struct Recorded final : RecordedWork {
      void queue() override {
        for (const auto& f : work) f();
        ++*queued;
      }
      Tape::Work work;
      int* queued = nullptr;
    };
    struct Backwards final : Recording {
      void side_by_side(size_t n, const std::function<void(size_t, void*)>& queue) override {
        EXPECT_LE(n, most);
        for (size_t k = n; k-- > 0;) queue(k, nullptr);  // in any order
      }
      size_t most = 0;
    } recording;
    recording.most = most_beside;
    auto recorded = std::make_unique<Recorded>();
    recorded->queued = &n_queued;
    tape_.records_to = &recorded->work;
    work(recording);
    tape_.records_to = nullptr;
    if (refuses) throw Error("it does not want to");
    return recorded;
  }
  bool refuses = false;
  int n_recorded = 0, n_queued = 0, n_steps = 0;

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    tape_.queue([this, jobs, io, worlds] {
      n_steps += jobs.list[0] == Job::step ? 1 : 0;
      for (int world = 0; world < n_worlds(); ++world) {
        if (worlds == Worlds::listed && !listed_[static_cast<size_t>(world)]) continue;
        WorldView w = world_view(state_.view(), params().n_agents, world);
        attach_scratch(w, layout_, scratch_.data());
        const auto draws_at = [&](uint32_t step) {
          return PhiloxDraws(options_.seed, static_cast<uint32_t>(world), step);
        };
        run_jobs(SerialLanes{}, jobs, params(), w, draws_at, io, ending(), world);
      }
    });
  }
  void list_playing() override {
    EXPECT_EQ(tape_.records_to, nullptr) << "lists are told to the host, so they are never recorded";
    listed_.assign(static_cast<size_t>(n_worlds()), false);
    for (size_t world = 0; world < listed_.size(); ++world) listed_[world] = state_.view().phase[world] == Phase::plays;
    counts_.resize(static_cast<size_t>(n_lists()));
    counts_.push_back(std::count(listed_.begin(), listed_.end(), true));
  }

 private:
  Tape& tape_;
  const ScratchLayout layout_;
  Buffer<char> scratch_;
  std::vector<bool> listed_;
  std::vector<int64_t> counts_;
};

/// Draws its actions, by work that may be recorded; each kListPeriod steps it draws others.
class Taped final : public TeamController {
 public:
  Taped(Tape& tape, bool repeats) : tape_(tape), repeats_(repeats) {}

  ObservationSet reads() const override { return {}; }
  bool repeats() const override { return repeats_; }
  void act(std::span<const TeamStep> parts) override {
    ++asked;
    for (const TeamStep& part : parts) {
      const auto which = static_cast<uint32_t>(part.number % kListPeriod == 0);
      tape_.queue([draws = part.draws(), action = static_cast<int32_t*>(part.buffers.action), n = part.n_rows(),
                   which] {
        for (int64_t row = 0; row < n; ++row)
          action[row] =
              static_cast<int32_t>(draws.key(row).uniform(Draw::opponent, draws.agent(row), which) * kNDiscreteActions);
      });
    }
  }
  int asked = 0;

 private:
  Tape& tape_;
  const bool repeats_;
};

/// Notes the age of world 0 after each step; its work may be recorded.
class Ages final : public GameObserver {
 public:
  explicit Ages(Tape& tape) : tape_(tape) {}

  bool repeats() const override { return true; }
  void after_step(int64_t, const GameStep& step) override { note(step); }
  void record_step(int k, const GameStep& step) override {
    EXPECT_EQ(k, recorded++);
    note(step);
  }
  void after_recorded(const GameStep&) override { ++periods; }

  std::vector<int32_t> ages;
  int recorded = 0, periods = 0;

 private:
  void note(const GameStep& step) {
    tape_.queue([this, age = step.sim->state().view().episode_length] { ages.push_back(*age); });
  }
  Tape& tape_;
};

SimOptions recorded_options(int episodes) {
  SimOptions options;
  options.n_worlds = kWorlds;
  options.seed = 5;
  options.on_done = OnDone::freeze;
  options.episodes = episodes;
  return options;
}

TEST(Game, ObserversThatRepeatThemselvesAreRecordedToo) {
  const SimSpec spec = game_spec();
  const auto play = [&](bool repeats) {
    Tape tape;
    RecordingSimulator sim(spec, recorded_options(3), tape);
    const auto team = std::make_shared<Taped>(tape, repeats);
    Ages ages(tape);
    Game game(sim, parallel_for(), {everywhere(team, sim), everywhere(team, sim)}, {&ages});
    game.start();
    game.play(1000);
    EXPECT_EQ(ages.recorded, repeats ? kListPeriod : 0);
    EXPECT_EQ(ages.periods, sim.n_queued);
    EXPECT_EQ(sim.n_queued > 0, repeats);
    return ages.ages;
  };
  const std::vector<int32_t> plain = play(false);
  EXPECT_GT(plain.size(), 20u);
  EXPECT_EQ(play(true), plain);
}

TEST(Game, WhatCannotBeRecordedIsQueuedOneByOne) {
  const SimSpec spec = game_spec();
  const auto play = [&](bool refuses) {
    Tape tape;
    RecordingSimulator sim(spec, recorded_options(3), tape);
    sim.refuses = refuses;
    const auto team = std::make_shared<Taped>(tape, true);
    Game game(sim, parallel_for(), {everywhere(team, sim), everywhere(team, sim)});
    game.start();
    for (int k = 0; k < 3; ++k) game.play(24);
    EXPECT_EQ(game.refusal(), refuses ? "it does not want to" : "");
    EXPECT_EQ(sim.n_recorded, refuses ? 1 : 3) << "it is asked once";
    return sim.state().save();
  };
  EXPECT_EQ(play(true), play(false));
}

// Lists are made every kListPeriod steps of a simulator, whatever game takes them.
TEST(Game, GoesOnBetweenTwoLists) {
  const SimSpec spec = game_spec();
  const auto play = [&](bool repeats) {
    Tape tape;
    RecordingSimulator sim(spec, recorded_options(3), tape);
    const auto team = std::make_shared<Taped>(tape, repeats);
    const BothSides sides = {everywhere(team, sim), everywhere(team, sim)};
    Game first(sim, parallel_for(), sides);
    first.start();
    first.play(5);
    Game second(sim, parallel_for(), sides);
    second.resume();
    second.play(1000);
    EXPECT_EQ(sim.n_queued > 0, repeats);
    EXPECT_EQ(second.refusal(), "");
    return sim.state().save();
  };
  EXPECT_EQ(play(true), play(false));
}

TEST(Game, RecordedStepsAreTheSame) {
  constexpr int kEpisodes = 3, kMost = 30 * kEpisodes;
  struct Played {
    std::vector<uint8_t> state;
    int steps, asked, recorded, queued;
  };
  SimSpec spec = game_spec();
  const auto play = [&](bool repeats, const std::vector<int64_t>& pieces, GameObserver* observer = nullptr) {
    Tape tape;
    RecordingSimulator sim(spec, recorded_options(kEpisodes), tape);
    const auto a = std::make_shared<Taped>(tape, true), b = std::make_shared<Taped>(tape, repeats);
    Game game(sim, parallel_for(), {Side{{a, {0, 3}}, {b, {3, 4}}}, Side{{b, {0, 2}}, {a, {2, 5}}}});
    if (observer) game.watch(*observer);
    game.start();
    for (const int64_t n : pieces) game.play(n);
    return Played{sim.state().save(), sim.n_steps, a->asked, sim.n_recorded, sim.n_queued};
  };
  const Played plain = play(false, {1000});
  EXPECT_EQ(plain.recorded, 0);
  EXPECT_EQ(plain.asked, plain.steps);
  EXPECT_GT(plain.steps, 20);
  EXPECT_LE(plain.steps, kMost + 4 * kListPeriod) << "lists of two periods ago";
  const Played recorded = play(true, {1000});
  EXPECT_EQ(recorded.state, plain.state);
  EXPECT_EQ(recorded.steps, plain.steps) << "it learns at the same step that all wait";
  EXPECT_EQ(recorded.recorded, 1);
  EXPECT_EQ(recorded.queued, plain.steps / kListPeriod - 1) << "but the first period";
  EXPECT_EQ(recorded.asked, 2 * kListPeriod) << "in the first period and while the second was recorded";

  // A time limit, pieces that end within a period, and observers, for whom nothing is recorded.
  for (const std::vector<int64_t>& pieces : {std::vector<int64_t>{21}, {5, 30, 3, 24}, {8, 8, 8, 8}, {16, 7, 17}}) {
    const Played once = play(false, pieces), again = play(true, pieces);
    EXPECT_EQ(again.state, once.state);
    EXPECT_EQ(again.steps, once.steps);
  }
  EXPECT_EQ(play(true, {8, 8, 8, 8}).recorded, 0) << "each play begins with a period that is not recorded";
  Witness witness;
  const Played watched = play(true, {1000}, &witness);
  EXPECT_EQ(watched.recorded, 0);
  EXPECT_EQ(watched.state, plain.state);
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
