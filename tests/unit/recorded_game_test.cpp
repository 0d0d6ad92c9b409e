// Games whose steps are recorded and queued a period at a time: they are those that are queued one by one.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <vector>

#include "core/error.hpp"
#include "game/game.hpp"
#include "game_spec.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/step.hpp"

namespace giga::test {
namespace {

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
    if (refuses) throw DeviceError("it does not want to");
    if (fails) throw Error("it is broken");
    return recorded;
  }
  bool refuses = false, fails = false;
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
  bool repeats_where_kept() const override { return repeats_ && where_kept; }
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
  bool where_kept = true;

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

/// One that does not repeat itself: its games are queued step by step.
struct StepByStep final : GameObserver {};

SimOptions recorded_options(int episodes) {
  SimOptions options;
  options.n_worlds = kWorlds;
  options.seed = 5;
  options.on_done = OnDone::freeze;
  options.episodes = episodes;
  return options;
}

/// A game whose work is recorded, with one controller for both sides, which repeats itself or does not.
struct TapedGame {
  explicit TapedGame(bool repeats, bool refuses = false) : team(std::make_shared<Taped>(tape, repeats)) {
    sim.refuses = refuses;
  }
  Game play_with(const std::vector<GameObserver*>& observers = {}) {
    return Game(sim, parallel_for(), {everywhere(team, sim), everywhere(team, sim)}, observers);
  }

  Tape tape;
  RecordingSimulator sim{game_spec(), recorded_options(3), tape};
  std::shared_ptr<Taped> team;
};

TEST(RecordedGame, ObserversThatRepeatThemselvesAreRecordedToo) {
  const auto play = [](bool repeats) {
    TapedGame taped(repeats);
    Ages ages(taped.tape);
    Game game = taped.play_with({&ages});
    game.start();
    game.play(1000);
    EXPECT_EQ(ages.recorded, repeats ? kListPeriod : 0);
    EXPECT_EQ(ages.periods, taped.sim.n_queued);
    EXPECT_EQ(taped.sim.n_queued > 0, repeats);
    return ages.ages;
  };
  const std::vector<int32_t> plain = play(false);
  EXPECT_GT(plain.size(), 20u);
  EXPECT_EQ(play(true), plain);
}

TEST(RecordedGame, WhatCannotBeRecordedIsQueuedOneByOne) {
  const auto play = [](bool refuses) {
    TapedGame taped(true, refuses);
    Game game = taped.play_with();
    game.start();
    for (int k = 0; k < 3; ++k) game.play(24);
    EXPECT_EQ(game.refusal(), refuses ? "it does not want to" : "");
    EXPECT_EQ(taped.sim.n_recorded, refuses ? 1 : 3) << "it is asked once";
    return taped.sim.state().save();
  };
  EXPECT_EQ(play(true), play(false));
}

// Plays of worlds that never wait are recorded whole, where they are as long as the one before, and observers say that
// plays are alike.
TEST(RecordedGame, WholePlays) {
  struct Alike final : GameObserver {
    explicit Alike(bool repeats) : repeats_(repeats) {}
    bool repeats_plays() const override { return repeats_; }
    void before_play(int64_t) override { ++plays; }
    const bool repeats_;
    int plays = 0;
  };
  SimOptions options = recorded_options(1);
  options.on_done = OnDone::reset;
  struct Played {
    std::vector<uint8_t> state;
    int steps, recorded, queued;
  };
  const auto play = [&](bool repeats, const std::vector<int64_t>& plays, size_t watched_before = 100,
                        bool refuses = false, bool where_kept = true) {
    Tape tape;
    RecordingSimulator sim(game_spec(), options, tape);
    sim.refuses = refuses;
    const auto team = std::make_shared<Taped>(tape, true);
    team->where_kept = where_kept;
    Alike observer(repeats), late(true);
    Game game(sim, parallel_for(), {everywhere(team, sim), everywhere(team, sim)}, {&observer});
    game.start();
    for (size_t k = 0; k < plays.size(); ++k) {
      if (k == watched_before) game.watch(late);
      game.play(plays[k]);
    }
    EXPECT_EQ(observer.plays, plays.size());
    EXPECT_EQ(game.refusal(), refuses ? "it does not want to" : "");
    return Played{sim.state().save(), sim.n_steps, sim.n_recorded, sim.n_queued};
  };
  const auto expect = [&](const std::vector<int64_t>& plays, int recorded, int queued, size_t watched_before = 100) {
    const Played plain = play(false, plays), whole = play(true, plays, watched_before);
    EXPECT_EQ(plain.recorded, 0);
    EXPECT_EQ(whole.recorded, recorded);
    EXPECT_EQ(whole.queued, queued);
    EXPECT_EQ(whole.steps, plain.steps);
    EXPECT_EQ(whole.state, plain.state);
  };
  expect({16, 16, 16, 16}, 1, 3);
  expect({16, 16, 24, 24, 16, 16}, 3, 3);
  expect({12, 12, 12}, 0, 0);             // not a whole number of periods
  expect({16, 16, 16, 16, 16}, 2, 3, 2);  // another observer before the third: that play is queued step by step
  EXPECT_EQ(play(true, {16, 16, 16}, 100, false, false).recorded, 0) << "its log-probabilities are LibTorch's";
  const Played refused = play(true, {16, 16, 16, 16}, 100, true);
  EXPECT_EQ(refused.recorded, 1) << "it is asked once";
  EXPECT_EQ(refused.state, play(false, {16, 16, 16, 16}).state);
}

TEST(RecordedGame, WhatFailsOtherwiseEndsIt) {
  TapedGame taped(true);
  taped.sim.fails = true;
  Game game = taped.play_with();
  game.start();
  EXPECT_THROW(game.play(24), Error);
  EXPECT_EQ(game.refusal(), "");
}

// Lists are made every kListPeriod steps of a simulator, whatever game takes them.
TEST(RecordedGame, GoesOnBetweenTwoLists) {
  const auto play = [](bool repeats) {
    TapedGame taped(repeats);
    Game first = taped.play_with();
    first.start();
    first.play(5);
    Game second = taped.play_with();
    second.resume();
    second.play(1000);
    EXPECT_EQ(taped.sim.n_queued > 0, repeats);
    EXPECT_EQ(second.refusal(), "");
    return taped.sim.state().save();
  };
  EXPECT_EQ(play(true), play(false));
}

TEST(RecordedGame, IsTheSame) {
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
  StepByStep observer;
  const Played watched = play(true, {1000}, &observer);
  EXPECT_EQ(watched.recorded, 0);
  EXPECT_EQ(watched.state, plain.state);
}

}  // namespace
}  // namespace giga::test
