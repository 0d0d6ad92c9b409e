// What a win is, as a user meets it: stated by `scenarios`, and followed by eval, the best checkpoint and ratings.
#include <gtest/gtest.h>

#include "io/run_folder.hpp"
#include "program.hpp"

namespace giga::test {
namespace {

// One against one in a world so wide that a waypoint covers half of it: team 0, in the middle, is in nearly every one,
// team 1, at the border, in one of fifty, and nobody gets to another place or dies in 60 steps. In 5 % of the episodes
// no waypoint appears (0.95^59).
constexpr const char* kRace = R"(description: team 0 stands where the waypoints are
team_0: [{type: default, count: 1}]
team_1: [{type: default, count: 1}]
limit_x: 2000
limit_y: 1000
max_episode_length: 60
maps: m
map_definitions: {m: {size: [2000, 1000], team_0: {area: [995, 495, 1005, 505]}, team_1: {area: [20, 495, 30, 505]}}}
waypoints: {enable_waypoints: true, waypoint_size: 1000}
win: {by: waypoints}
)";

/// The race, and the same with other rules of what a win is.
void write_races(const Workplace& here) {
  here.write("race.yaml", kRace);
  here.write("survival.yaml", "base: race.yaml\nwin: {by: elimination}\n");
  here.write("hiding.yaml", "base: race.yaml\nwin: {by: elimination, at_time_limit: team_1}\n");
}

TEST(Win, ScenariosSayWhatItIs) {
  const Workplace here;
  write_races(here);
  EXPECT_TRUE(contains(here.run({"scenarios", "show", "./race.yaml"}).out,
                       {"with all its keys.\n# A win: more waypoints than the other team when the episode ends. A tie: "
                        "as many.\n",
                        "\nwin:", "by: waypoints"}));
  EXPECT_TRUE(contains(here.run({"scenarios", "show", "hide_and_seek_10_vs_5_fobs"}).out,
                       {"# A win: the other team is wiped out first; for team 1 also: both live after 500 steps."}));
  const std::string list = here.run({"scenarios"}).out;
  const auto line_of = [&](const std::string& name) {
    const size_t begin = list.find("\n" + name + " ") + 1;
    return list.substr(begin, list.find('\n', begin) - begin);
  };
  EXPECT_TRUE(contains(line_of("identical_5_vs_5"), {" elimination  "}));
  EXPECT_TRUE(contains(line_of("waypoint_3_vs_3"), {" waypoints  "}));
  EXPECT_TRUE(contains(line_of("hide_and_seek_5_vs_10"), {" elimination or time  "}));
}

TEST(Win, EvalGoesByIt) {
  const Workplace here;
  write_races(here);
  const auto eval = [&](const std::string& scenario) {
    const Outcome outcome = here.run({"eval", "circle", "--vs", "circle", "--scenario", scenario, "--episodes", "64",
                                      "--device", "cpu", "--json", "-"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return parse_yaml_text(outcome.out, "json");
  };
  const Document race = eval("./race.yaml"), survival = eval("./survival.yaml"), hiding = eval("./hiding.yaml");
  EXPECT_GT(number_at(race, {"sides", "0", "win_rate"}), 0.8);
  EXPECT_LT(number_at(race, {"sides", "0", "loss_rate"}), 0.1);
  EXPECT_EQ(number_at(survival, {"sides", "0", "tie_rate"}), 1);
  EXPECT_EQ(number_at(hiding, {"sides", "0", "loss_rate"}), 1);
  EXPECT_EQ(number_at(survival, {"sides", "0", "mean_score"}), number_at(race, {"sides", "0", "mean_score"}));
  EXPECT_EQ(at(survival, {"win"}).text,
            "A win: the other team is wiped out first. A tie: both are wiped out in the same step, or both live after "
            "60 steps.");
  EXPECT_TRUE(contains(here.run({"eval", "circle", "--vs", "circle", "--scenario", "./hiding.yaml", "--episodes", "2",
                                 "--device", "cpu"})
                           .out,
                       {"scenario hiding\nA win: the other team is wiped out first; for team 1 also: both live"}));
}

TEST(Win, TheBestCheckpointAndRatingsGoByIt) {
  const Workplace here;
  write_races(here);
  here.write("run.yaml", R"(scenario: ./race.yaml
device: cpu
train: {n_worlds: 16, total_agent_steps: 256, n_threads: 1, opponent: circle, learning_team: 0}
mappo: {horizon: 8, n_minibatches: 2, n_epochs: 1, actor: {hidden: [8]}, critic: {hidden: [8]}}
eval: {episodes: 64, every_updates: 1, opponents: [circle]}
)");
  const auto best_score = [&](const std::string& scenario) {
    const Outcome training =
        here.run({"train", "run.yaml", "--run-dir", scenario, "--quiet", "--set", "scenario=./" + scenario + ".yaml"});
    EXPECT_EQ(training.code, 0) << training.err;
    return find_checkpoint((here.path() / scenario).string()).checkpoint.cursor.best_score;
  };
  EXPECT_GT(best_score("race"), 0.8);
  EXPECT_EQ(best_score("survival"), 0) << "nobody dies";

  const auto ratings = [&](const std::string& scenario) {
    const Outcome outcome = here.run({"rate", "race", "--scripted", "circle", "--checkpoints", "1", "--episodes", "16",
                                      "--scenario", "./" + scenario + ".yaml", "--device", "cpu", "--json", "-"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return parse_yaml_text(outcome.out, "json");
  };
  EXPECT_TRUE(contains(at(ratings("race"), {"win"}).text, {"A win: more waypoints"}));
  EXPECT_EQ(at(ratings("race"), {"sides"}).text, "alike");
  EXPECT_EQ(at(ratings("hiding"), {"sides"}).text, "apart") << "who is on side 1 wins there";
}

}  // namespace
}  // namespace giga::test
