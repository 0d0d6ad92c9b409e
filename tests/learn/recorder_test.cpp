// The recorder: whatever room it has, whether steps are recorded or not, and beside whatever matches, it keeps the
// same.
#include "eval/recorder.hpp"

#include <gtest/gtest.h>

#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "recorded.hpp"

namespace giga::test {
namespace {

/// What is kept of the games with so much room on the device.
std::vector<ReplayEpisode> episodes_with(const Recorded& recorded, int64_t most_bytes) {
  Recorder recorder(recorded.run.spec, {recorded.mind(), Mind{}}, {.most_bytes = most_bytes});
  recorded.play_again(recorder);
  return recorder.episodes(cat(kGamesSeed));
}

TEST(LearnRecorder, RoomForAFewStatesIsEnough) {
  SmallRun small = recorded_run();
  small.scenario = long_games(50);
  const Recorded recorded(small);
  Replay all = recorded.replay, few = all;
  all.episodes = episodes_with(recorded, int64_t{128} << 20);
  few.episodes = episodes_with(recorded, 1);  // kListPeriod states
  EXPECT_EQ(encode_replay(all), encode_replay(recorded.replay));
  for (size_t k = 0; k < all.episodes.size(); ++k) {
    const ReplayEpisode &a = all.episodes[k], &b = few.episodes[k];
    ASSERT_GT(a.steps, 2 * kListPeriod);
    EXPECT_EQ(a.state_check, b.state_check);
    EXPECT_EQ(a.action_check, b.action_check);
    EXPECT_EQ(a.x, b.x);
    ASSERT_EQ(a.mind[0].value.size(), b.mind[0].value.size());  // products may round by the number of rows
    EXPECT_NEAR(a.mind[0].low, b.mind[0].low, 1e-4);
    EXPECT_EQ(a.mind[0].likely.size(), b.mind[0].likely.size());
  }
}

/// Tells a recorder of the steps of a game as if whole periods were recorded, the first one aside.
struct AsRecorded final : GameObserver {
  explicit AsRecorded(Recorder& of) : recorder(of) {}
  void before_step(int64_t t, GameStep& step) override { recorder.before_step(t, step); }
  void after_step(int64_t t, const GameStep& step) override {
    if (t < kListPeriod || t >= 48) return recorder.after_step(t, step);
    recorder.record_step(static_cast<int>(t % kListPeriod), step);
    if (t % kListPeriod == kListPeriod - 1) recorder.after_recorded(step);
  }
  Recorder& recorder;
};

TEST(LearnRecorder, PeriodsAreKeptAsTheirSteps) {
  SmallRun small = recorded_run();
  small.scenario = long_games(50);
  const Recorded recorded(small);
  for (const int64_t most_bytes : {int64_t{1}, int64_t{128} << 20}) {
    Recorder recorder(recorded.run.spec, {recorded.mind(), Mind{}}, {.most_bytes = most_bytes});
    AsRecorded periods(recorder);
    recorded.play_again(periods);
    Replay replay = recorded.replay;
    replay.episodes = recorder.episodes(replay.seed);
    EXPECT_EQ(replay.episodes.at(0).steps, 50);
    if (most_bytes > 1) {
      EXPECT_EQ(encode_replay(replay), encode_replay(recorded.replay));
    }
    EXPECT_EQ(verify_replay(replay, {}), "");
    EXPECT_EQ(replay.episodes[2].mind[0].likely, recorded.replay.episodes[2].mind[0].likely);
  }
}

// Beside other matches, in the last worlds of their simulator, the games are those of a match by itself.
TEST(LearnRecorder, BesideOtherMatches) {
  for (const char* memory : {"", ", memory: gru, memory_size: 8"}) {
    SmallRun small = recorded_run();
    small.actor += memory;
    if (*memory) small.critic = "kind: independent, hidden: [8], memory: gru";
    const LoadedRun run = small.load();
    const auto learner = small.learner();
    const std::shared_ptr<TeamController> learned = policy_controller(*learner->actor(0)),
                                          circle = script_controller(Scripted::circle);
    const std::vector<Pairing> pairs = {{{learned, circle}}, {{circle, learned}}};
    const MatchOptions options{5, 7, {}, 2};
    const auto play = [&](int episodes, bool alone) {
      TeamRecording games(run, *learner, episodes, options);
      WatchedPair watched = games.games();
      watched.alone = alone;
      const std::vector<MatchResult> results = play_matches(run.spec, pairs, options, &watched);
      EXPECT_EQ(results.size(), 2u);
      EXPECT_EQ(results[0].episodes, 5);
      games.finish();
      const Replay replay = games.replay("0.1.0");
      EXPECT_EQ(replay.episodes.size(), static_cast<size_t>(episodes));
      EXPECT_EQ(verify_replay(replay, {}), "");
      return std::pair(encode_replay(replay), results[1].mean_return[1]);
    };
    EXPECT_EQ(play(3, false), play(3, true));
    EXPECT_EQ(play(6, false).second, play(3, true).second) << "more than the others have episodes: by itself";
  }
}

/// Whether steps were recorded; recorders see the same.
struct Periods final : GameObserver {
  bool repeats() const override { return true; }
  void after_recorded(const GameStep&) override { ++count; }
  int count = 0;
};

/// One that does not repeat itself: its games are queued step by step.
struct StepByStep final : GameObserver {};

TEST(LearnRecorderGpu, RecordedStepsAreTheSame) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  for (const char* action : {"", "action: continuous\n"}) {
    SmallRun small = recorded_run();
    small.precision = "tf32";
    small.scenario = long_games(90) + action;
    const LoadedRun run = small.load();
    const auto learner = small.learner(gpu);
    const auto values = values_of(run, *learner, 0, gpu);
    const auto play = [&](bool step_by_step, int64_t most_bytes) {
      Recorder recorder(run.spec, {Mind{learner->actor(0), values.get()}, Mind{learner->actor(1), nullptr}},
                        {.most_bytes = most_bytes});
      Periods periods;
      StepByStep one_by_one;
      std::vector<GameObserver*> observers = {&recorder, &periods};
      if (step_by_step) observers.push_back(&one_by_one);
      play_games(run, *learner, observers, gpu);
      EXPECT_EQ(periods.count > 0, !step_by_step) << "a graph was queued";
      Replay replay = replay_frame(run.scenario, run.spec, "0.1.0");
      replay.seed = cat(kGamesSeed);
      replay.players = {"a", "b"};
      replay.episodes = recorder.episodes(replay.seed);
      EXPECT_EQ(verify_replay(replay, {}), "");
      return encode_replay(replay);
    };
    const std::string expected = play(true, int64_t{128} << 20);
    EXPECT_EQ(play(false, int64_t{128} << 20), expected);
    EXPECT_EQ(play(false, int64_t{128} << 20), expected);
    EXPECT_EQ(play(false, 1), expected) << "room for kListPeriod states";
  }
}

}  // namespace
}  // namespace giga::test
