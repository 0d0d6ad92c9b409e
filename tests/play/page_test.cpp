// The page of play: its size, and a real browser that plays: the same numbers as here, keys that fly, a game that is
// saved.
#include "play/page.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "eval/record.hpp"
#include "io/browser.hpp"
#include "io/devtools.hpp"
#include "io/temporary_folder.hpp"
#include "io/web_server.hpp"
#include "play/plain_actor.hpp"
#include "play/scenarios.hpp"
#include "play/session.hpp"
#include "play/spec_bytes.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "support/thinning.hpp"
#include "watch/reference_pictures.hpp"

namespace giga::test {
namespace {

/// A screen that is touched.
constexpr const char* kFinger = "--window-size=1280,900 --blink-settings=primaryPointerType=2,availablePointerTypes=2";

PageScenario page_scenario(const std::string& name, const Scenario& scenario, int n_players) {
  PageScenario page{name, compile(scenario), {}, {}};
  page.frame = replay_frame(scenario, page.spec, "0.1.0");
  for (auto& all : page.players)
    for (int k = 0; k < n_players; ++k) all.push_back(k);
  return page;
}

PageScenario page_scenario(const std::string& name, int n_players) {
  return page_scenario(name, load_scenario(name, data_dirs()), n_players);
}

/// All base scenarios of as many agents as a page plays, first the one that is named, with all scripts.
PlayPage page_of_scripts(const std::string& first) {
  PlayPage page;
  page.title = "</script><b id=evil>x";
  page.about = "about";
  page.version = "0.1.0";
  const int n = static_cast<int>(enum_names(Scripted{}).size());
  for (int k = 0; k < n; ++k) {
    const int who = network_of_script(static_cast<Scripted>(k));
    page.players.push_back({name_of(static_cast<Scripted>(k)), {who, who}});
  }
  page.opponents = static_cast<int>(Scripted::pursuer);
  page.mates = static_cast<int>(Scripted::circle);
  page.scenarios.push_back(page_scenario(first, n));
  for (const ScenarioInfo& info : list_scenarios(data_dirs())) {
    if (info.name == first || agents_of(load_scenario(info.name, data_dirs())) > kMostAgents) continue;
    page.scenarios.push_back(page_scenario(info.name, n));
  }
  return page;
}

/// A policy of the quickstart's size.
Actor quickstart_actor(const SimSpec& spec, uint64_t seed, MemoryKind memory = MemoryKind::none,
                       NetworkInputs inputs = NetworkInputs::all) {
  ActorConfig config;
  config.hidden = {64, 64};
  config.output_gain = 3;
  config.memory = memory;
  return Actor(config, input_columns(inputs, spec), spec.params.actions, false, Precision::fp32, at::kCPU, seed);
}

TEST(PlaySpec, ComesBackFromBytes) {
  for (const char* name : {"special_5_vs_5", "waypoint_5_vs_3", "hide_and_seek_5_vs_5"}) {
    const SimSpec spec = compile(load_scenario(name, data_dirs()));
    const SimSpec again = read_spec(spec_bytes(spec));
    EXPECT_EQ(states_hash(again, 50), states_hash(spec, 50)) << name;
    EXPECT_EQ(again.name, spec.name);
    EXPECT_EQ(again.observation_size(), spec.observation_size());
  }
  const std::string bytes = spec_bytes(compile(load_scenario("identical_1_vs_1", data_dirs())));
  EXPECT_THROW(read_spec(bytes.substr(0, bytes.size() - 1)), Error);
  EXPECT_THROW(read_spec(bytes + "x"), Error);
}

class PlayPageTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!has_play_module()) GTEST_SKIP() << kNoPlayModule;
  }
};

TEST_F(PlayPageTest, IsSmallAndAsksForNothing) {
  PlayPage page = page_of_scripts("identical_5_vs_5");
  const SimSpec& spec = page.scenarios[0].spec;
  for (uint64_t team = 0; team < kNTeams; ++team)
    page.networks.push_back(plain_network_of(quickstart_actor(spec, team), spec.observation_size(), false));
  page.players.push_back({"quickstart", {0, 1}});
  const std::string html = play_page(page);
  RecordProperty("bytes", static_cast<int>(html.size()));
  std::cout << "a page with the scenarios of up to " << kMostAgents
            << " agents and two networks: " << html.size() / 1024 << " KB\n";
  EXPECT_LE(html.size(), size_t{600} << 10);
  page.scenarios.resize(1);
  page.networks.clear();
  EXPECT_LE(play_page(page).size(), size_t{400} << 10) << "one scenario, scripts alone";
  EXPECT_EQ(html.find("<b id=evil>"), std::string::npos);
  EXPECT_EQ(html.find("{{"), std::string::npos) << "a place that was not filled";
  for (const char* outside : {"http://", "https://", "src=\"", "@import"})
    EXPECT_EQ(html.find(outside), std::string::npos) << outside;
}

TEST_F(PlayPageTest, AsAFolder) {
  const TemporaryFolder folder;
  PlayPage page = page_of_scripts("identical_5_vs_5");
  page.scenarios.resize(1);
  write_play_folder(folder / "site", page);
  for (const char* name : {"index.html", "play.css", "play.js", "game.json", "play.wasm"})
    EXPECT_TRUE(std::filesystem::exists(folder / "site" / name)) << name;
  EXPECT_EQ(read_file(folder / "site/play.wasm").substr(0, 4), std::string("\0asm", 4));
  EXPECT_EQ(read_file(folder / "site/index.html").find("{{"), std::string::npos);
}

class PlayInBrowser : public InBrowser {
 protected:
  void SetUp() override {
    if (!has_play_module()) GTEST_SKIP() << kNoPlayModule;
    InBrowser::SetUp();
  }
  Document use_part(const PlayPage& page, const std::string& part, const std::string& options) const {
    return use(play_page(page), "play",
               reference_pictures("play") + "const PART = \"" + part +
                   "\", HASH_STEPS = " + std::to_string(hash_steps()) + ";\n",
               options);
  }
  static int hash_steps() { return tests_run_in_full() ? 5000 : 300; }
};

TEST_F(PlayInBrowser, ComputesTheSameNumbersAsHere) {
  const PlayPage page = page_of_scripts("identical_5_vs_5");
  const Document seen = use_part(page, "hash", "--window-size=1280,900");
  EXPECT_EQ(texts(seen, "problems"), std::vector<std::string>());
  const std::vector<std::string> hashes = texts(seen, "hashes");
  ASSERT_EQ(hashes.size(), page.scenarios.size());
  ASSERT_GT(hashes.size(), 15u);
  for (size_t k = 0; k < hashes.size(); ++k) {
    char expected[17];
    std::snprintf(expected, sizeof expected, "%016llx",
                  static_cast<unsigned long long>(states_hash(page.scenarios[k].spec, hash_steps())));
    EXPECT_EQ(hashes[k], page.scenarios[k].name + " " + expected);
  }
}

TEST_F(PlayInBrowser, KeysFlyAndASavedGameIsVerified) {
  PlayPage page = page_of_scripts("waypoint_5_vs_3");
  page.scenarios.resize(1);
  page.scenarios.push_back(page_scenario("special_5_vs_5_cont", static_cast<int>(page.players.size())));
  const Document seen = use_part(page, "play", kFinger);
  EXPECT_EQ(texts(seen, "problems"), std::vector<std::string>());
  EXPECT_EQ(texts(seen, "requests"), std::vector<std::string>());
  EXPECT_EQ(text(seen, "injected"), "0");
  EXPECT_EQ(text(seen, "checked"), "Checked: it computes the same numbers as the trainer.");
  EXPECT_EQ(text(seen, "players"), "10 10") << "all scripts, as mates and as opponents";
  EXPECT_EQ(text(seen, "chosen"), "circle pursuer");
  EXPECT_EQ(text(seen, "waits"), "true") << "nothing moves before a key is pressed";
  EXPECT_EQ(text(seen, "runs"), "true");
  // Left: 9 x 1 + 3 x 2 + 1; then faster and climbing too: 9 x 2 + 3 x 2 + 2; then nothing: 9 + 3 + 1.
  EXPECT_EQ(texts(seen, "actions"), (std::vector<std::string>{"16", "26", "13"}));
  EXPECT_EQ(text(seen, "turned"), "true");
  EXPECT_EQ(text(seen, "paused"), "true");
  EXPECT_EQ(text(seen, "touch_shown"), "flex");
  // It starts the game; the middle of the stick is straight on, 13; its upper left corner faster to the left, 18 + 6 +
  // 1; a button climbs too, 18 + 6 + 2; climbing alone is 9 + 3 + 2, diving 9 + 3; 13 where a finger has left.
  EXPECT_EQ(texts(seen, "touch"), (Texts{"true", "13", "25", "26", "14", "13", "12", "13"}));
  // What hands at rest do to a stick starts nothing; to the upper right is faster to the right, 18 + 0 + 1; a button
  // dives too, 18; another climbs, 9 + 3 + 2; the right stick dives, 9 + 3. Start pauses, goes on, and begins a new
  // game.
  EXPECT_EQ(texts(seen, "gamepad"), (Texts{"false", "true", "19", "18", "14", "12", "false", "true", "false"}));
  EXPECT_EQ(text(seen, "eyes"), "0") << "what agent 0 knows is shown";
  EXPECT_EQ(text(seen, "hidden"), "true") << "an opponent that it does not know is not drawn";
  EXPECT_EQ(text(seen, "shown"), "true") << "with everybody shown it is";
  EXPECT_EQ(text(seen, "map"), "true");
  EXPECT_EQ(text(seen, "over"), "true");
  EXPECT_TRUE(contains(text(seen, "dead"), {"You are dead: agent 0 ", ". Enter: a new game, F: to the end"}));
  EXPECT_EQ(text(seen, "unnamed"), "0") << "controls without a name";
  expect_pictures(seen, "play", {"top", "solid"});
  for (const char* name : {"discrete", "continuous"}) {
    const Replay replay = decode_replay(from_hex(text(seen, name)), name);
    EXPECT_EQ(verify_replay(replay, {}), "") << name;
    EXPECT_TRUE(contains(replay.players[0], {"a person (agent 0) and circle"}));
    EXPECT_EQ(replay.players[1], "pursuer");
    // What verify compares beside the states.
    Replay changed = replay;
    changed.episodes[0].events.pop_back();
    EXPECT_EQ(verify_replay(changed, {}), "episode 0 has the same states, but differs in its events");
    changed = replay;
    changed.episodes[0].sees[0] ^= 1;
    EXPECT_EQ(verify_replay(changed, {}), "episode 0 has the same states, but differs in who detects whom");
  }
}

// Keys as a keyboard sends them, to a page that is drawn as on a screen.
TEST_F(PlayInBrowser, AKeyboardFliesInRealTime) {
  PlayPage page = page_of_scripts("identical_5_vs_5");
  page.scenarios.resize(1);
  write_file(folder_ / "game.html", play_page(page));
  LiveBrowser browser(browser_, "file://" + (folder_ / "game.html").string(), folder_.path(), "1280,900");
  browser.wait_until("window.play && play.scene");
  browser.value("play.start('5')");
  const double before = browser.value("play.episode.heading[0]");
  browser.key(true, "KeyA", "a");
  browser.wait_until("play.episode.steps >= 4");
  browser.key(false, "KeyA", "a");
  browser.key(true, "KeyP", "p");
  browser.key(false, "KeyP", "p");
  browser.wait_until("!play.running");
  // 4 rad/s for some steps of 0.1 s each, to the left.
  const double after = browser.value("play.episode.heading[4]");
  EXPECT_GT(std::sin(after - before), 0.1);
  EXPECT_EQ(browser.value("[...play.episode.done[2]].at(0)"), 16) << "left: 9 x 1 + 3 x 2 + 1";
  EXPECT_EQ(browser.problems(), "");
}

// Space climbs and Enter begins a new game whatever the mouse has pressed before.
TEST_F(PlayInBrowser, AClickLeavesTheKeysToTheGame) {
  PlayPage page = page_of_scripts("identical_5_vs_5");
  page.scenarios.resize(1);
  write_file(folder_ / "game.html", play_page(page));
  LiveBrowser browser(browser_, "file://" + (folder_ / "game.html").string(), folder_.path(), "1280,900");
  browser.wait_until("window.play && play.scene");
  const auto press = [&](const std::string& code, const std::string& key) {
    browser.key(true, code, key);
    browser.key(false, code, key);
  };
  for (const char* control : {"#pause", "#restart", "#all"}) {
    browser.value("play.start('5')");
    browser.click(control);
    browser.wait_until("document.activeElement.id === 'field'");
    browser.key(true, "Space", " ");
    browser.wait_until("play.episode.steps >= 3 && play.episode.z[play.person * play.episode.states + 3] > 0");
    browser.key(false, "Space", " ");
    EXPECT_EQ(browser.value("play.running"), true) << control;
  }
  press("Enter", "Enter");
  browser.wait_until("play.episode.steps < 3");
  // By the keyboard alone a button is a button.
  browser.value("$('pause').focus(); play.run(false)");
  press("Space", " ");
  EXPECT_EQ(browser.value("document.activeElement.id"), "pause");
  EXPECT_EQ(browser.problems(), "");
}

// The folder from a web server: the same start, the same moves.
TEST_F(PlayInBrowser, AFolderPlaysFromAWebServer) {
  const std::string python = python_with("http.server");
  if (python.empty()) GTEST_SKIP() << "no Python";
  PlayPage page = page_of_scripts("identical_5_vs_5");
  page.scenarios.resize(1);
  write_play_folder(folder_ / "site", page);
  write_file(folder_ / "game.html", play_page(page));
  const WebServer server(python, folder_ / "site");
  const auto played = [&](const std::string& address) {
    LiveBrowser browser(browser_, address, folder_.path(), "1280,900");
    browser.wait_until("window.play && play.scene");
    browser.value("play.start('5'); play.advance(20, [0, 0, 0])");
    EXPECT_EQ(browser.value("play.episode.steps"), 20);
    EXPECT_EQ(browser.problems(), "");
    return browser.value("String(play.episode.check)").get<std::string>();
  };
  const std::string from_server = played(server.address());
  EXPECT_NE(from_server, "0");
  EXPECT_EQ(from_server, played("file://" + (folder_ / "game.html").string()));
}

TEST_F(PlayInBrowser, NetworksPlayThereAsLibTorchPlaysThemHere) {
  PlayPage page = page_of_scripts("identical_5_vs_5");
  Scenario scenario = load_scenario("identical_5_vs_5", data_dirs());
  scenario.observation.egocentric_view = true;
  page.scenarios = {page_scenario("identical_5_vs_5", scenario, 1)};
  const SimSpec& spec = page.scenarios[0].spec;
  std::vector<Actor> actors;
  std::array<RecordedTeam, kNTeams> teams;
  for (uint64_t team = 0; team < kNTeams; ++team) {
    // One reads the egocentric view, one remembers.
    actors.push_back(team == 0 ? quickstart_actor(spec, team, MemoryKind::none, NetworkInputs::egocentric)
                               : quickstart_actor(spec, team, MemoryKind::gru));
    page.networks.push_back(plain_network_of(actors.back(), spec.observation_size(), true));
  }
  for (size_t team = 0; team < kNTeams; ++team) teams[team] = {policy_controller(actors[team], true), {}, "a"};
  page.players = {{"networks", {0, 1}}};
  page.mates = page.opponents = 0;
  page.scenarios[0].players = {std::vector<int>{0}, std::vector<int>{0}};
  const Document seen = use_part(page, "watch", "--window-size=500,900 --blink-settings=preferredColorScheme=0");
  EXPECT_EQ(texts(seen, "problems"), std::vector<std::string>());
  EXPECT_EQ(text(seen, "wide"), "true") << "nothing is wider than a phone's screen";
  const Replay there = decode_replay(from_hex(text(seen, "discrete")), "discrete");
  const Replay here = record_match(scenario, spec, teams, {1, 7, {}, 1}, "0.1.0").replay;
  EXPECT_EQ(text(seen, "again"), "true") << "a second game with the same seed is the same";
  EXPECT_EQ(there.seed, "7");
  EXPECT_EQ(there.episodes[0].action, here.episodes[0].action);
  EXPECT_EQ(there.episodes[0].state_check, here.episodes[0].state_check);
  EXPECT_EQ(verify_replay(there, {}), "");
}

}  // namespace
}  // namespace giga::test
