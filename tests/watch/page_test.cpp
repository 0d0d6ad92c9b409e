// The page of replays: its size, and what it does in a real browser.
#include "watch/page.hpp"

#include <gtest/gtest.h>

#include "io/browser.hpp"
#include "io/sample_replay.hpp"
#include "watch/reference_pictures.hpp"

namespace giga::test {
namespace {

TEST(WatchPage, HoldsItsGamesAndNothingElseIsAskedFor) {
  const std::string page = watch_page({encode_replay(sample_replay())}, "</script><b id=evil>x", "0.1.0");
  EXPECT_LT(page.size(), 400u << 10);
  EXPECT_EQ(page.find("<b id=evil>"), std::string::npos);
  EXPECT_EQ(page.find("{{"), std::string::npos) << "a place that was not filled";
  for (const char* outside : {"http://", "https://", "src=\"", "@import"})
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
}

class WatchInBrowser : public InBrowser {
 protected:
  Document use_replays(const std::vector<std::string>& replays, const std::string& references,
                       const std::string& options) const {
    return use(watch_page(replays, "<b id=evil>a</b> against b", "0.1.0"), "watch", references, options);
  }
};

TEST_F(WatchInBrowser, ShowsTheStepThatIsAskedFor) {
  const Document seen =
      use_replays({encode_replay(sample_replay())}, reference_pictures("watch"), "--window-size=1280,900");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(texts(seen, "requests"), Texts());
  EXPECT_EQ(text(seen, "injected"), "0");
  EXPECT_EQ(text(seen, "games"), "1");
  EXPECT_EQ(text(seen, "panes"), "1");
  // x of agent 0: 500, 550, 600, 650, 700 in units of 10 / 5000; agent 1 dies in step 3, agent 0 reaches the
  // waypoint in step 2.
  EXPECT_EQ(texts(seen, "scrubbed"),
            (Texts{"step 0: 1.00 1.00 team 0 2 of 2 alive, 0 waypoints team 1 1 of 1 alive, 0 waypoints",
                   "step 1: 1.10 1.00 team 0 2 of 2 alive, 0 waypoints team 1 1 of 1 alive, 0 waypoints",
                   "step 2: 1.20 1.00 team 0 2 of 2 alive, 1 waypoints team 1 1 of 1 alive, 0 waypoints",
                   "step 3: 1.30 1.00 team 0 1 of 2 alive, 1 waypoints team 1 1 of 1 alive, 0 waypoints",
                   "step 4: 1.40 1.00 team 0 1 of 2 alive, 1 waypoints team 1 1 of 1 alive, 0 waypoints "
                   "over: team 0 wins at the time limit"}));
  EXPECT_EQ(text(seen, "color"), "0 114 178") << "team 0 is #0072b2";
  EXPECT_EQ(text(seen, "right"), "2");
  EXPECT_EQ(text(seen, "home"), "0");
  EXPECT_EQ(text(seen, "next_event"), "1");
  EXPECT_EQ(text(seen, "spoken"), "a waypoint appears");
  EXPECT_EQ(text(seen, "view"), "3d");
  EXPECT_EQ(text(seen, "side"), "0");
  EXPECT_EQ(text(seen, "known_by_0"), "110") << "in step 1 nobody of team 0 detects agent 2";
  EXPECT_EQ(text(seen, "chosen"), "0");
  // In step 1: action 13 is straight on; value -1 + 31 x 1 / 31 = 0; 10 of 15 = 67 %; hears agent 1 in steps 0 and 2
  // only; the waypoint's centre is (0.15, 0.25) away, at 59 degrees.
  EXPECT_TRUE(contains(text(seen, "agent"),
                       {"Agent 0, team 0, default", "Health 1.00 of 1; at (1.1, 1.0)", "Hears nobody",
                        "Knows of 0 of 1 living opponents", "Does: straight on", "Expects a return of 0.00",
                        "straight on 67 %", "The waypoint is 0.3 away, 59° to the left"}));
  EXPECT_EQ(text(seen, "curve_shown"), "true");
  EXPECT_EQ(text(seen, "dead"), "Dead since step 3: agent 1 is shot down by agent 2.");
  EXPECT_EQ(text(seen, "played_to"), "4");
  EXPECT_EQ(text(seen, "stopped"), "true");
  EXPECT_NE(texts(seen, "grounds").at(0), texts(seen, "grounds").at(1));
  EXPECT_EQ(texts(seen, "events").back(), "0.4 s  team 0 wins at the time limit");
  EXPECT_EQ(text(seen, "unnamed"), "0") << "controls without a name";
  EXPECT_EQ(text(seen, "panes_beside"), "2");
  expect_pictures(seen, "watch", {"top", "solid"});
}

// A page made of a damaged replay, or by a newer gigastep, says so, and not that the browser is too old.
TEST_F(WatchInBrowser, SaysWhyAReplayCannotBeShown) {
  const std::string whole = encode_replay(sample_replay());
  const struct {
    std::string replay, why;
  } cases[] = {
      {whole.substr(0, whole.size() / 2), "a replay is damaged: it ends too early, or its bytes were changed"},
      {"<html>" + whole, "a replay is damaged: its first line makes no sense"},
      {"gigastep replay 9" + whole.substr(whole.find('\n')),
       "a replay has format 9, newer than 4, which this page reads"},
      {"gigastep replay 1" + whole.substr(whole.find('\n')),
       "a replay has format 1, older than 3, which this page reads"},
  };
  for (const auto& c : cases) {
    const Document seen = use_replays({c.replay}, "const REFERENCES = null;\n", "--window-size=500,900");
    EXPECT_EQ(texts(seen, "problems"), Texts());
    EXPECT_EQ(text(seen, "about"), "The games cannot be shown: " + c.why + ".");
  }
}

TEST_F(WatchInBrowser, TwoReplaysSideBySideOnAPhone) {
  const Document seen =
      use_replays({encode_replay(sample_replay(ReplayActions::continuous)), encode_replay(sample_replay())},
                  "const REFERENCES = null;\n", "--window-size=500,900 --blink-settings=preferredColorScheme=0");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(text(seen, "games"), "2");
  EXPECT_EQ(text(seen, "panes"), "2");
  EXPECT_EQ(texts(seen, "grounds").at(0), "rgb(18, 21, 27)");  // --ground of the dark theme, #12151b
  EXPECT_EQ(text(seen, "wide"), "true") << "nothing is wider than the screen";
  EXPECT_TRUE(contains(text(seen, "agent"), {"Mean of its actions: left 1.00, climb 1.00, faster 1.00"}));
}

}  // namespace
}  // namespace giga::test
