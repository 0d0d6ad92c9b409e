// The rewards of the configs that set them (the published setting has the original's), under the corrected rules, in
// every scenario of up to 40 agents that they are for: who fights earns more than who dies at once, idles, circles or
// hides, and dying at once is never the better way to lose. Then those of the published configs, in their own scenario
// under their own rules; the original's make an exception.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "core/error.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "scripted/actions.hpp"
#include "sim/simulator.hpp"
#include "sim/vector_observation.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga {
namespace {

constexpr int kMostAgents = 40;

/// How a team plays. `fight` is what a scenario is about: shooting, waypoints, staying unseen.
enum class Way : uint8_t { fight, circle, hide, leave, straight_out, idle };
constexpr const char* kWayNames[] = {"fight", "circle", "hide", "leave", "straight_out", "idle"};

/// Prices for one scenario alone, that of the config. Images: with a price on leaving that is high enough for agents of
/// any health, agents that see little keep away from everything and never learn to attack.
constexpr const char* kOfOneScenario = "pixels.yaml";

struct Environment {
  Node node;
  std::string scenario;  // in which alone it is meant to hold; empty: in all
};

/// The `environment:` of the configs that set rewards, each once. What agents observe is no part of the game.
std::map<std::string, Environment> environments() {
  std::map<std::string, Environment> distinct;
  for (const auto& file : std::filesystem::directory_iterator(test::source_path("configs"))) {
    const Document config = parse_yaml_file(file.path());
    const Node* environment = config.root.find("environment");
    if (!environment || !environment->find("rewards")) continue;
    Node game = *environment;
    std::erase_if(game.entries, [](const Node::Entry& entry) { return entry.key == "observation"; });
    const bool one = file.path().filename() == kOfOneScenario;
    distinct.emplace(print_node(game), Environment{*environment, one ? config.root.find("scenario")->text : ""});
  }
  return distinct;
}

/// Full throttle to the nearest border: a whole team is gone within about 20 steps.
int32_t leave(const ObservationReader& obs) {
  const SimParams& p = obs.rules();
  const OwnState own = obs.own();
  const float distance[] = {own.x, p.limit_x - own.x, own.y, p.limit_y - own.y};
  const Direction out[] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
  const Direction& d = out[std::min_element(distance, distance + 4) - distance];
  const SinCos ahead = sin_cos(own.heading);
  const float sine = ahead.cos * d.y - ahead.sin * d.x;
  const bool turned = ahead.cos * d.x + ahead.sin * d.y > 0 && std::fabs(sine) < 0.2f;
  return discrete_action({turned ? 0.0f : (sine < 0 ? -1.0f : 1.0f), 0, 1});
}

/// Whole episodes of one scenario between two ways to play.
class Games {
 public:
  /// `factor`: of all rewards but game_won, as mappo.shaping_final_factor leaves it.
  Games(SimSpec spec, float factor) : spec_(std::move(spec)), factor_(factor) {}

  /// Mean return of a team per episode, as EpisodeStat::return_0 counts it.
  double mean_return(int team, Way own, Way other) {
    const auto ways = team == 0 ? std::pair(own, other) : std::pair(other, own);
    if (const auto found = played_.find(ways); found != played_.end()) return found->second[static_cast<size_t>(team)];
    return (played_[ways] = play({ways.first, ways.second}))[static_cast<size_t>(team)];
  }

  /// Whether staying unseen is what the scenario asks of the team.
  bool is_to_hide(int team) const { return spec_.name.starts_with("hide") && team == 1; }

 private:
  Scripted script(int team, Way way) const {
    if (way == Way::circle) return Scripted::circle;
    if (way == Way::hide) return Scripted::hider;
    if (spec_.params.waypoints) return Scripted::waypoint_runner;
    return is_to_hide(team) ? Scripted::evader : Scripted::pursuer;
  }

  std::array<double, kNTeams> play(const std::array<Way, kNTeams>& ways) const {
    SimOptions options;
    options.n_worlds = spec_.params.n_agents > 20 ? 16 : 32;
    options.seed = 3;
    options.on_done = OnDone::freeze;
    options.n_threads = 1;
    const auto sim = make_cpu_simulator(spec_, options);
    const SimParams& p = sim->params();
    const StateView& state = sim->state().view();
    const int columns = VectorObservation::shape(p).size();
    std::vector<float> obs[kNTeams];
    std::vector<int32_t> action[kNTeams];
    StepIo io;
    for (int team = 0; team < kNTeams; ++team) {
      action[team].resize(static_cast<size_t>(options.n_worlds) * static_cast<size_t>(p.n_team[team]));
      obs[team].resize(action[team].size() * static_cast<size_t>(columns));
      io.team[team].action = action[team].data();
      io.team[team].obs[Observation::vector].rows = obs[team].data();
    }
    sim->start(io);
    std::fill_n(state.reward_factor, options.n_worlds, factor_);
    for (int step = 0; step < p.max_episode_length; ++step) {
      for (int team = 0; team < kNTeams; ++team) {
        const Way way = ways[static_cast<size_t>(team)];
        const RowDraws draws{state.draw_step, options.seed, 0, p.n_team[team], team};
        const ScriptedActions scripted{
            script(team, way), p.actions, draws, state.episode_length, action[team].data(), p,
            obs[team].data(),  columns};
        for (size_t row = 0; row < action[team].size(); ++row) {
          if (way == Way::leave)
            action[team][row] = leave({p, obs[team].data() + row * static_cast<size_t>(columns)});
          else if (way == Way::straight_out)
            action[team][row] = 22;  // straight with full throttle
          else if (way == Way::idle)
            action[team][row] = 13;  // nothing
          else
            scripted(static_cast<int64_t>(row));
        }
      }
      sim->step(io);
    }
    const EpisodeStats stats = sim->take_stats();
    GIGA_CHECK(stats[EpisodeStat::episodes] == options.n_worlds, "not all episodes ended");
    return {stats[EpisodeStat::return_0] / options.n_worlds, stats[EpisodeStat::return_1] / options.n_worlds};
  }

  SimSpec spec_;
  const float factor_;
  std::map<std::pair<Way, Way>, std::array<double, kNTeams>> played_;
};

int n_agents(const Scenario& scenario) {
  int count = 0;
  for (const auto* team : {&scenario.team_0, &scenario.team_1})
    for (const TeamEntry& entry : *team) count += entry.count;
  return count;
}

DataDirs source_data() { return {test::source_path()}; }
constexpr const char* kFamilies[] = {"identical", "special", "waypoint", "hide_and_seek"};

class ConfigRewards : public ::testing::TestWithParam<const char*> {
 protected:
  /// Calls f(games, team, opponent) in every scenario of the family, under every environment, for both teams against
  /// teams that circle and teams that fight.
  template <class F>
  void in_each(F&& f) {
    int n_scenarios = 0, n_of_family = 0;
    const int stride = test::thinned(6);
    for (const ScenarioInfo& info : list_scenarios(source_data())) {
      if (!info.name.starts_with(GetParam()) || n_agents(load_scenario(info.name, source_data())) > kMostAgents)
        continue;
      if (load_scenario(info.name, source_data()).waypoints.shown_steps) continue;  // no script remembers a waypoint
      if (n_of_family++ % stride != 0) continue;
      const auto turn = static_cast<size_t>(n_of_family / stride);
      size_t n_environments = 0;
      for (const auto& [text, environment] : environments()) {
        if (!environment.scenario.empty() && environment.scenario != info.name) continue;
        const Scenario scenario = load_scenario(info.name, source_data(), &environment.node, "environment");
        SimSpec spec = compile(scenario);
        spec.params.egocentric_view = false;  // nobody here reads it
        ++n_scenarios;
        ++n_environments;
        // Whole, and faded; thinned, one of them in each scenario.
        const std::vector<float> factors = {1.0f, 0.1f};
        for (size_t k = 0; k < factors.size(); ++k) {
          if (stride > 1 && k != (turn + n_environments) % factors.size()) continue;
          Games games(spec, factors[k]);
          for (int team = 0; team < kNTeams; ++team)
            for (const Way opponent : {Way::circle, Way::fight}) {
              SCOPED_TRACE(cat(info.name, ", team ", team, " against a team that plays ",
                               kWayNames[static_cast<size_t>(opponent)], "; shaping x ", factors[k],
                               "; environment: ", text));
              f(games, team, opponent);
            }
        }
      }
    }
    EXPECT_GT(n_scenarios, 0);
  }
};

/// Fighting is what a scenario asks for, so nothing else may pay as much; but a team that is to hide may do so.
void expect_that_fighting_earns_most(Games& games, int team, Way opponent) {
  const double fight = games.mean_return(team, Way::fight, opponent);
  for (const Way other : {Way::circle, Way::hide, Way::leave, Way::straight_out, Way::idle}) {
    if (other == Way::hide && games.is_to_hide(team)) continue;
    EXPECT_GT(fight, games.mean_return(team, other, opponent)) << kWayNames[static_cast<size_t>(other)];
  }
}

TEST_P(ConfigRewards, FightingEarnsMostAndDyingAtOnceLeast) {
  in_each([](Games& games, int team, Way opponent) {
    expect_that_fighting_earns_most(games, team, opponent);
    const double circle = games.mean_return(team, Way::circle, opponent);
    const double leave = games.mean_return(team, Way::leave, opponent);
    // A team that is shot down while it stays must not wish that it had left: the price of leaving exceeds what the
    // shots cost that kill an agent, 0.05 x weight of damage x (health / 0.1), which is 75 for the health 3 of `super`,
    // and 25 for the health 1 of most.
    EXPECT_GT(circle, leave);
  });
}
INSTANTIATE_TEST_SUITE_P(Families, ConfigRewards, ::testing::ValuesIn(kFamilies),
                         [](const auto& family) { return std::string(family.param); });

/// The scenario, rules and rewards of a config of the published setting; configs/published.yaml is the base of all.
SimSpec published_spec(const std::string& name) {
  const Document config = parse_yaml_file(test::source_path(cat("configs/", name, ".yaml")));
  const Document base = parse_yaml_file(test::source_path("configs/published.yaml"));
  const auto text_of = [&](const char* key) {
    const Node* own = config.root.find(key);
    return (own ? own : base.root.find(key))->text;
  };
  Scenario scenario = load_scenario(text_of("scenario"), source_data(), config.root.find("environment"), "environment");
  scenario.rules = text_of("rules") == "original" ? Rules::original : Rules::corrected;
  SimSpec spec = compile(scenario);
  spec.params.egocentric_view = false;  // nobody here reads it
  return spec;
}

/// Calls f(games, team, opponent) for both teams against teams that circle and teams that fight; whole, and faded.
template <class F>
void in_published(const std::string& config, F&& f) {
  for (const float factor : {1.0f, 0.1f}) {
    Games games(published_spec(config), factor);
    for (int team = 0; team < kNTeams; ++team)
      for (const Way opponent : {Way::circle, Way::fight}) {
        SCOPED_TRACE(cat(config, ", team ", team, " against a team that plays ",
                         kWayNames[static_cast<size_t>(opponent)], "; shaping x ", factor));
        f(games, team, opponent);
      }
  }
}

TEST(ConfigRewardsPublished, FightingEarnsMost) {
  for (const char* config : {"published", "published_corrected", "published_egocentric"})
    in_published(config, expect_that_fighting_earns_most);
}

TEST(ConfigRewardsPublished, DyingAtOnceEarnsLeastUnderTheCorrectedRules) {
  in_published("published_corrected", [](Games& games, int team, Way opponent) {
    // Leaving costs five agents collision_obstacle 100 each, divided by all ten: 50. Being shot costs nothing.
    for (const Way other : {Way::circle, Way::hide, Way::straight_out, Way::idle})
      EXPECT_GT(games.mean_return(team, other, opponent), games.mean_return(team, Way::leave, opponent))
          << kWayNames[static_cast<size_t>(other)];
  });
}

// Under the original's rules collision_obstacle is paid to nobody: a team pays agent_disabled 50 for each of its five
// agents, by all ten 25, and defeat_one_opponent, whatever they die of. Only who is shot down pays for the shots too:
// 0.05 x 50 x (1 / 0.1) = 25 an agent, 12.5 a team, at most. So dying at once earns less than staying where nobody
// shoots, and more where a team that does not fight is shot down. docs/training.md says so.
TEST(ConfigRewardsPublished, UnderTheOriginalsRulesWhoIsShotDownHadBetterLeft) {
  in_published("published_egocentric", [](Games& games, int team, Way opponent) {
    const double leave = games.mean_return(team, Way::leave, opponent);
    for (const Way other : {Way::circle, Way::hide}) {
      const double stay = games.mean_return(team, other, opponent);
      if (opponent == Way::circle)
        EXPECT_LT(leave, stay) << kWayNames[static_cast<size_t>(other)];
      else
        EXPECT_GT(leave, stay) << kWayNames[static_cast<size_t>(other)];
    }
  });
}

TEST(ConfigRewardsFamilies, CoverEveryScenarioOfUpToFortyAgents) {
  for (const ScenarioInfo& info : list_scenarios(source_data())) {
    if (n_agents(load_scenario(info.name, source_data())) > kMostAgents) continue;
    int families = 0;
    for (const char* family : kFamilies) families += info.name.starts_with(family);
    EXPECT_EQ(families, 1) << info.name;
  }
  EXPECT_FALSE(environments().empty());
}

}  // namespace
}  // namespace giga
