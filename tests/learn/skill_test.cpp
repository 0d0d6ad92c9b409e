// What the quickstart learns in 3 million agent-steps (thinned: in one), on one thread, so that a seed always learns
// the same.
#include <gtest/gtest.h>

#include <string>

#include "eval/match.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

TEST(LearnSkill, TheQuickstartBeatsScriptsAfterThreeMillionAgentSteps) {
  const bool full = thinned(3) == 1;
  const int64_t steps = full ? 3'000'000 : 1'000'000;
  const LoadedRun run =
      load_run_config(source_path("configs/quickstart.yaml"),
                      {cat("train.total_agent_steps=", steps), "train.n_threads=1", "device=cpu", "seed=1"});
  const auto learner = make_learner(run, Device{});
  while (learner->agent_steps_done() < steps) learner->update();

  // Seed 1 came to 1.00 and 1.00 against random, 0.98 and 0.96 against circle; after one million to 0.95 and 0.94, 0.47
  // and 0.42, untrained to 0.
  struct Bound {
    Scripted opponent;
    double win_rate;
  };
  for (const Bound bound : {Bound{Scripted::random, full ? 0.9 : 0.85}, Bound{Scripted::circle, full ? 0.8 : 0.2}}) {
    for (int team = 0; team < 2; ++team) {
      auto learned = policy_controller(*learner->actor(team)), script = script_controller(bound.opponent);
      if (team == 1) std::swap(learned, script);
      const MatchResult r = play_match(run.spec, std::move(learned), std::move(script), {512, 7, {}, 1});
      const double win_rate = r.wins[team] / 512.0;
      const std::string name = cat("team_", team, "_vs_", enum_names(Scripted{})[static_cast<size_t>(bound.opponent)]);
      RecordProperty(name, std::to_string(win_rate));
      EXPECT_GE(win_rate, bound.win_rate) << name;
    }
  }
}

}  // namespace
}  // namespace giga::test
