// Worlds of more agents than a page plays: the simulator as a browser runs it, by a module that is built for this test,
// and the native one come to the same states.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>

#include "eval/record.hpp"
#include "io/browser.hpp"
#include "io/deflate.hpp"
#include "play/page.hpp"
#include "play/scenarios.hpp"
#include "play/session.hpp"
#include "play/spec_bytes.hpp"
#include "scenario/compile.hpp"
#include "support/thinning.hpp"
#include "watch/page.hpp"

namespace giga::test {
namespace {

std::string packed(const std::string& bytes) { return "\"" + base64(deflated(bytes)) + "\""; }

/// 100 steps of 2,000 agents; of others as many agent-steps, but one step at least.
int steps_of(int n_agents) { return std::max(1, (tests_run_in_full() ? 200'000 : 20'000) / n_agents); }

class CrowdsInBrowser : public InBrowser {
 protected:
  void SetUp() override {
    if (!has_play_module()) GTEST_SKIP() << kNoPlayModule;
    InBrowser::SetUp();
  }
};

TEST_F(CrowdsInBrowser, ComputesTheSameNumbersAsHere) {
  PlayPage page;
  page.version = "0.1.0";
  page.players.push_back(
      {name_of(Scripted::random), {network_of_script(Scripted::random), network_of_script(Scripted::random)}});
  const Scenario small = load_scenario("identical_1_vs_1", data_dirs());
  PageScenario& shown = page.scenarios.emplace_back(PageScenario{"identical_1_vs_1", compile(small), {}, {}});
  shown.frame = replay_frame(small, shown.spec, page.version);
  shown.players = {std::vector<int>{0}, std::vector<int>{0}};

  std::string crowds;
  Texts expected;
  for (const ScenarioInfo& info : list_scenarios(data_dirs())) {
    const Scenario scenario = load_scenario(info.name, data_dirs());
    const int n_agents = agents_of(scenario), steps = steps_of(n_agents);
    if (n_agents <= kMostAgents) continue;
    const SimSpec spec = compile(scenario);
    char hash[17];
    std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(states_hash(spec, steps)));
    expected.push_back(info.name + " " + std::to_string(steps) + " " + hash);
    crowds += "[\"" + info.name + "\", " + std::to_string(steps) + ", " + packed(spec_bytes(spec)) + "],";
  }
  ASSERT_GE(expected.size(), 3u);
  const Document seen = use(play_page(page), "play",
                            "const REFERENCES = null, PART = \"crowds\", CROWDS = [" + crowds +
                                "];\nconst MODULE = " + packed(read_file(GIGASTEP_CROWDS_MODULE)) + ";\n",
                            "--window-size=500,900");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(texts(seen, "hashes"), expected);
}

}  // namespace
}  // namespace giga::test
