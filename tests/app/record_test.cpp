// gigastep record and picture as a user runs them: a replay, its page, playing it again, pictures, and what train
// keeps.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "io/browser.hpp"
#include "io/files.hpp"
#include "io/replay.hpp"
#include "program.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

constexpr size_t kMostCrowd = size_t{1} << 20;
constexpr std::vector<int16_t> ReplayEpisode::*kStateColumns[] = {&ReplayEpisode::x,     &ReplayEpisode::y,
                                                                  &ReplayEpisode::z,     &ReplayEpisode::heading,
                                                                  &ReplayEpisode::speed, &ReplayEpisode::health};

/// A checksum that the readers of other languages compute too.
template <class T>
int32_t sum_of(const std::vector<T>& column) {
  uint32_t sum = 0;
  for (const T value : column) sum = sum * 31 + static_cast<uint32_t>(static_cast<int32_t>(value));
  return static_cast<int32_t>(sum);
}

size_t size_of_file(const Workplace& here, const std::string& name) { return here.read(name).size(); }

TEST(Record, GamesOfAHalfMinuteFitTheirSizes) {
  const Workplace here;
  // Both circle for all 500 steps, ten agents.
  for (const char* episodes : {"1", "2"}) {
    const Outcome outcome = here.run({"record", "circle", "--vs", "circle", "--scenario", "identical_5_vs_5_void",
                                      "--episodes", episodes, "--out", std::string("g") + episodes});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.out, {std::string("g") + episodes + ".replay: circle against circle, " + episodes}));
  }
  EXPECT_LE(size_of_file(here, "g1.replay"), 15u << 10);
  EXPECT_LE(size_of_file(here, "g2.html"), size_of_file(here, "g1.html") + (25u << 10));
  EXPECT_LE(size_of_file(here, "g1.html"), (400u + 25u) << 10);
}

// Networks that have learned not to hit walls, in games without weapons and collisions: ten agents live for 500 steps,
// actions are drawn at random, and each is kept with what the networks said.
class RecordedPolicies : public InBrowser {
 protected:
  static void SetUpTestSuite() {
    here_ = std::make_unique<Workplace>();
    const Outcome training =
        here_->run({"train", "quickstart", "--run-dir", "run", "--quiet", "--device", "cpu", "--set",
                    "train.total_agent_steps=4_000_000", "--set", "eval.every_updates=1000", "--set", "eval.record=0"});
    EXPECT_EQ(training.code, 0) << training.err;
    const Outcome games =
        here_->run({"record", "run", "--episodes", "16", "--device", "cpu", "--set",
                    "environment.damage.damage_cone_depth=0", "--set", "environment.collision.collision_range=0"});
    EXPECT_EQ(games.code, 0) << games.err;
  }
  static void TearDownTestSuite() { here_.reset(); }
  void SetUp() override {}
  static Replay replay() { return decode_replay(here_->read("game.replay"), "game.replay"); }

  static std::unique_ptr<Workplace> here_;
};
std::unique_ptr<Workplace> RecordedPolicies::here_;

TEST_F(RecordedPolicies, LongGamesFitTheirSizes) {
  const Replay all = replay();
  Replay one = all;
  one.episodes.clear();
  const size_t empty = encode_replay(one).size();
  int long_ones = 0;
  size_t largest = 0;
  for (const ReplayEpisode& e : all.episodes) {
    int lived = 0;
    for (const int died : e.died) lived += died < 0 ? e.steps : died;
    if (lived < 4900) continue;
    ++long_ones;
    EXPECT_EQ(e.mind[0].top, 3);
    EXPECT_LT(e.mind[0].low, e.mind[0].high);
    one.episodes = {e};
    largest = std::max(largest, encode_replay(one).size() - empty);
  }
  std::cout << long_ones << " games of 500 steps with ten living agents take up to " << largest << " bytes, in a page "
            << (largest + 2) / 3 * 4 << '\n';
  EXPECT_GT(long_ones, 0);
  EXPECT_LE(largest, 16u << 10);
  EXPECT_LE((largest + 2) / 3 * 4, 25u << 10) << "in base64, as pages hold them";
}

TEST_F(RecordedPolicies, AreTheSameBitForBitAndPythonReadsThem) {
  const Outcome again = here_->run({"record", "--verify", "game.replay", "--device", "cpu"});
  EXPECT_EQ(again.code, 0) << again.out << again.err;
  const std::string python = python_with("zlib");
  if (python.empty()) GTEST_SKIP() << "no Python";
  here_->write(
      "sums.py",
      "import sys\n"
      "sys.path.insert(0, sys.argv[1])\n"
      "from read_replay import read_replay\n"
      "for e in read_replay('game.replay')['episodes']:\n"
      "    unit = (e.place, e.place, 0.02, 6.283185307179586 / 65536, 0.05, 0.01)\n"
      "    rows = (e.x, e.y, e.z, e.heading, e.speed, e.health)\n"
      "    states = [[round(v / u) for row in column for v in row] for u, column in zip(unit, rows)]\n"
      "    likely = [[v for row in column for v in row] for column in e.likely]\n"
      "    parts = [b''.join(bytes(row) for row in e.action), e.sees.data, e.fires.data, e.hears.data, *likely]\n"
      "    sums = []\n"
      "    for column in states + parts:\n"
      "        total = 0\n"
      "        for value in column:\n"
      "            total = total * 31 + value & 0xFFFFFFFF\n"
      "        sums.append(total - (total >> 31 << 32))\n"
      "    print(*sums)\n");
  const std::string folder = std::filesystem::path(source_path("examples/read_replay.py")).parent_path().string();
  const Outcome sums = here_->run({"sums.py", folder}, python);
  ASSERT_EQ(sums.code, 0) << sums.err;
  std::string expected;
  for (const ReplayEpisode& e : replay().episodes) {
    for (const auto column : kStateColumns) expected += cat(sum_of(e.*column), ' ');
    expected += cat(sum_of(e.action), ' ', sum_of(e.sees), ' ', sum_of(e.fires), ' ', sum_of(e.hears), ' ',
                    sum_of(e.mind[0].likely), ' ', sum_of(e.mind[1].likely), '\n');
  }
  EXPECT_EQ(sums.out, expected);
}

TEST_F(RecordedPolicies, AreReadAlikeInABrowser) {
  InBrowser::SetUp();
  if (IsSkipped()) return;
  const Document seen = use(here_->read("game.html"), "app", "const PART = 'columns';\n", "--window-size=1280,900");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  Texts expected;
  for (const ReplayEpisode& e : replay().episodes) {
    std::string line;
    for (const auto column : kStateColumns) line += cat(sum_of(e.*column), ' ');
    line += cat(sum_of(e.action), ' ', sum_of(e.sees), ' ', sum_of(e.fires), ' ', sum_of(e.hears));
    for (const ReplayMind& mind : e.mind)
      line += cat(' ', sum_of(mind.value), ' ', sum_of(mind.likely), ' ', sum_of(mind.probability));
    expected.push_back(line);
  }
  EXPECT_EQ(texts(seen, "columns"), expected);
}

TEST(Record, PlaysAgainBitForBit) {
  const Workplace here;
  for (const char* scenario :
       {"identical_5_vs_5", "waypoint_5_vs_3_cont", "hide_and_seek_5_vs_5", "special_5_vs_1_fobs"}) {
    const Outcome outcome =
        here.run({"record", "pursuer", "--vs", "evader", "--scenario", scenario, "--episodes", "2"});
    ASSERT_EQ(outcome.code, 0) << scenario << outcome.err;
    const Outcome again = here.run({"record", "--verify", "game.replay"});
    EXPECT_EQ(again.code, 0) << scenario << again.out << again.err;
    EXPECT_EQ(again.out, "game.replay: played again, all 2 episodes are the same bit for bit\n");
  }
}

TEST(Record, PythonReadsIt) {
  const std::string python = python_with("zlib");
  if (python.empty()) GTEST_SKIP() << "no Python";
  const Workplace here;
  for (const char* scenario : {"identical_5_vs_5", "waypoint_5_vs_3_cont"}) {
    ASSERT_EQ(here.run({"record", "circle", "--vs", "pursuer", "--scenario", scenario, "--episodes", "2"}).code, 0);
    const Outcome words = here.run({source_path("examples/read_replay.py"), "game.replay"}, python);
    ASSERT_EQ(words.code, 0) << words.err;
    EXPECT_TRUE(contains(words.out, {std::string("circle against pursuer in ") + scenario, "episode 1: ", " dies ("}));
  }
}

TEST(Record, BesideAnother) {
  const Workplace here;
  const Outcome outcome = here.run({"record", "circle", "--vs", "pursuer", "--beside", "evader", "--scenario",
                                    "identical_2_vs_2", "--episodes", "1", "--out", "both.html"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(contains(outcome.out, {"both.replay: circle against pursuer",
                                     "both_beside.replay: evader against pursuer", "both.html: open it"}));
  EXPECT_TRUE(contains(here.read("both.html"), {"circle and evader against pursuer"}));
}

TEST(Record, WhatIsWrong) {
  const Workplace here;
  here.write("x.replay", "seed: 3\n");
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const Outcome outcome = here.run(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.out << outcome.err;
    EXPECT_TRUE(contains(outcome.err, {message}));
  };
  refused({"record"}, "A is missing");
  refused({"record", "cirle"}, "nearest: 'circle'");
  refused({"record", "circle"}, "name one with --scenario");
  refused({"record", "--verify", "x.replay"}, "x.replay is no replay");
  refused({"record", "--verify", "x.replay", "--episodes", "9"}, "--verify");
  refused({"record", "--verify", "x.replay", "--vs", "circle"}, "--verify");
  refused({"picture", "x.replay", "--out", "a.svg"}, "x.replay is no replay");
  refused({"picture", "nowhere.replay", "--out", "a.svg"}, "nowhere.replay");
  // Of a run in which one team learned, the opponent has to be named.
  here.write("short.yaml", kShortConfig);
  ASSERT_EQ(here.run({"train", "short.yaml", "--run-dir", "one", "--quiet", "--set", "train.opponent=circle"}).code, 0);
  refused({"record", "one"}, "one has no policy for side 1, where it would play against itself; --vs says");
  ASSERT_EQ(here.run({"record", "circle", "--scenario", "identical_1_vs_1", "--episodes", "1"}).code, 0);
  refused({"picture", "game.replay"}, "--out or --film says what to write");
  refused({"picture", "game.replay", "--out", "a.jpg"}, ".svg or .png");
  refused({"picture", "game.replay", "--film", "a.mp4"}, ".gif");
  refused({"picture", "game.replay", "--film", "a.gif", "--episode", "1"}, "the replay has 1");
}

TEST(Picture, PathsAndFilms) {
  const Workplace here;
  ASSERT_EQ(here.run({"record", "circle", "--vs", "pursuer", "--scenario", "identical_2_vs_2", "--episodes", "2"}).code,
            0);
  ASSERT_EQ(here.run({"picture", "game.replay", "--out", "t.svg"}).code, 0);
  ASSERT_EQ(
      here.run({"picture", "game.replay", "--out", "t.png", "--film", "f.gif", "--every", "10", "--size", "100"}).code,
      0);
  ASSERT_EQ(here.run({"picture", "game.replay", "--film", "frames", "--every", "25", "--size", "100"}).code, 0);
  const std::string svg = here.read("t.svg");
  // A path and a ring where it starts for each of 2 x 4 agents.
  size_t paths = 0;
  for (size_t at = 0; (at = svg.find("stroke-linejoin=\"round\"", at)) != std::string::npos; ++at) ++paths;
  EXPECT_EQ(paths, 8u);
  EXPECT_TRUE(contains(svg, {"circle against pursuer", "episode 1: "}));
  EXPECT_EQ(here.read("t.png").substr(1, 3), "PNG");
  EXPECT_EQ(here.read("f.gif").substr(0, 6), "GIF89a");
  EXPECT_TRUE(here.has("frames/00000.png") && here.has("frames/00001.png"));

  // One episode alone, told by its number.
  ASSERT_EQ(here.run({"picture", "game.replay", "--out", "one.svg", "--episode", "1"}).code, 0);
  const std::string one = here.read("one.svg");
  EXPECT_TRUE(contains(one, {"episode 1: ", "10 x 10 units; blue: team 0, orange: team 1"}));
  EXPECT_EQ(one.find("episode 0: "), std::string::npos);
  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& message) {
    const Outcome outcome = here.run(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.out;
    EXPECT_TRUE(contains(outcome.err, {message}));
  };
  refused({"picture", "game.replay", "--out", "two.svg", "--episode", "2"},
          "episode 2: the replay has 2, counted from 0");
  refused({"picture", "game.replay", "--out", "two.svg", "--size", "100"}, "--size is of a film: --film is missing");
  // The frames of a longer film would be the end of a shorter one.
  refused({"picture", "game.replay", "--film", "frames", "--every", "400", "--size", "100"},
          ".png is of a longer film; name another folder, or empty it");
}

TEST(Record, TrainingKeepsGames) {
  const Workplace here;
  here.write("tiny.yaml", kTinyConfig);
  const Outcome training = here.run({"train", "tiny.yaml", "--run-dir", "run", "--quiet", "--set", "eval.record=1"});
  ASSERT_EQ(training.code, 0) << training.err;
  // Evaluated after updates 2 and 3, the last.
  EXPECT_TRUE(here.has("run/replays/update_00000002.replay") && here.has("run/replays/update_00000003.replay"));
  EXPECT_TRUE(contains(here.read("run/report.html"), {"href=\"replays.html\""}));
  EXPECT_TRUE(contains(here.read("run/replays.html"), {"<title>run - gigastep replay</title>"}));
  const Outcome again = here.run({"record", "--verify", "run/replays/update_00000003.replay"});
  EXPECT_EQ(again.code, 0) << again.out << again.err;

  // A run that is complete gets its page again.
  const std::string page = here.read("run/replays.html");
  std::filesystem::remove(here.path() / "run/replays.html");
  EXPECT_EQ(here.run({"resume", "run"}).code, 0);
  EXPECT_EQ(here.read("run/replays.html"), page);

  // A report elsewhere finds the page on the way from there.
  ASSERT_EQ(here.run({"report", "run", "--out", "all.html"}).code, 0);
  EXPECT_TRUE(contains(here.read("all.html"), {"href=\"run/replays.html\""}));
  const Outcome none = here.run({"train", "tiny.yaml", "--run-dir", "none", "--quiet", "--set", "eval.record=0"});
  ASSERT_EQ(none.code, 0) << none.err;
  EXPECT_FALSE(here.has("none/replays") || here.has("none/replays.html"));
  // Recording changes nothing of what is learned.
  const auto hash = [&](const std::string& run) {
    const std::string text = here.run({"inspect", run + "/checkpoints/update_00000003.h5"}).out;
    return text.substr(text.find("sha"), 80);
  };
  EXPECT_EQ(hash("run"), hash("none"));
}

/// A game of the crowd whose agents see some 35 others, as `gigastep record` keeps it; in the short form of the tests
/// it ends after 80 steps, of some 200.
class RecordedCrowd : public InBrowser {
 protected:
  static void SetUpTestSuite() {
    here_ = std::make_unique<Workplace>();
    std::vector<std::string> arguments = {
        "record",     "pursuer", "--vs",  "circle", "--scenario", "swarm_1000_vs_1000",
        "--episodes", "1",       "--out", "crowd",  "--device",   "cpu"};
    if (!tests_run_in_full()) arguments.insert(arguments.end(), {"--set", "environment.max_episode_length=80"});
    const Outcome outcome = here_->run(arguments);
    EXPECT_TRUE(contains(outcome.out, {"crowd.replay: pursuer against circle, 1 episode, "})) << outcome.err;
  }
  static void TearDownTestSuite() { here_.reset(); }
  void SetUp() override {}

  static std::unique_ptr<Workplace> here_;
};
std::unique_ptr<Workplace> RecordedCrowd::here_;

TEST_F(RecordedCrowd, IsReadPlayedAgainAndDrawn) {
  EXPECT_LE(size_of_file(*here_, "crowd.replay"), kMostCrowd);
  const Outcome again = here_->run({"record", "--verify", "crowd.replay", "--device", "cpu"});
  EXPECT_EQ(again.out, "crowd.replay: played again, its one episode is the same bit for bit\n") << again.err;
  ASSERT_EQ(here_->run({"picture", "crowd.replay", "--out", "paths.svg", "--film", "f", "--every", "400"}).code, 0);
  EXPECT_LE(size_of_file(*here_, "paths.svg"), 4u << 20);
  EXPECT_TRUE(here_->has("f/00001.png"));
  const std::string python = python_with("zlib");
  if (python.empty()) return;
  const Outcome words = here_->run({source_path("examples/read_replay.py"), "crowd.replay"}, python);
  ASSERT_EQ(words.code, 0) << words.err;
  const Replay replay = decode_replay(here_->read("crowd.replay"), "crowd.replay");
  const auto& died = replay.episodes[0].died;
  EXPECT_EQ(static_cast<size_t>(std::count(words.out.begin(), words.out.end(), '\n')),
            2 + died.size() - static_cast<size_t>(std::count(died.begin(), died.end(), -1)))
      << "two lines, and one for each death";
}

TEST_F(RecordedCrowd, PlaysInABrowser) {
  InBrowser::SetUp();
  if (IsSkipped()) return;
  const Document seen = use(here_->read("crowd.html"), "app", "const PART = 'crowd';\n", "--window-size=1280,900");
  const Replay replay = decode_replay(here_->read("crowd.replay"), "crowd.replay");
  const ReplayEpisode& e = replay.episodes.at(0);
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(texts(seen, "requests"), Texts());
  EXPECT_EQ(text(seen, "agents"), "2000");
  EXPECT_EQ(text(seen, "steps"), std::to_string(e.steps));
  EXPECT_EQ(texts(seen, "layers"), Texts()) << "of a crowd these are hidden at first, or not kept";
  // Of each state: who lives, whom team 0 knows (itself and whom it sees), lines of fire, and those that hit.
  Texts states;
  for (const int k : {0, 70, e.steps}) {
    int living[2] = {0, 0}, known = 1000, fire = 0, hits = 0;
    const int row = (e.steps + 8) / 8;
    for (int i = 0; i < 2000; ++i) {
      const int died = e.died[static_cast<size_t>(i)];
      living[i / 1000] += died < 0 || k < died;
      if (i >= 1000) known += e.sees[static_cast<size_t>(i * row + k / 8)] >> (k & 7) & 1;
    }
    for (const ReplayFire& f : e.fire) {
      if (f.from > k || k > f.to) continue;
      ++fire;
      hits += k - f.from + 1 > replay.rules.min_tracking_time;
    }
    states.push_back(cat(k, ": ", living[0], " ", living[1], " ", known, " ", fire, " ", hits));
  }
  EXPECT_EQ(texts(seen, "states"), states);
  EXPECT_TRUE(contains(text(seen, "first"), {"Agent 0, team 0, default"}));
  EXPECT_TRUE(contains(text(seen, "last"), {"Agent 999, team 0, default"}));
  EXPECT_EQ(text(seen, "played"), "true");
  EXPECT_EQ(text(seen, "view"), "3d");
}

TEST(Record, AWorldThatIsTooLargeIsNamed) {
  const Workplace here;
  const Outcome outcome = here.run({"record", "circle", "--scenario", "swarm_million"});
  EXPECT_EQ(outcome.code, 2) << outcome.out;
  EXPECT_TRUE(contains(outcome.err, {"scenario 'swarm_million' has 1000000 agents in a world; replays hold games of at "
                                     "most 20000"}));
}

}  // namespace
}  // namespace giga::test
