// A step whose parameters are constants of the compiler is the same step, bit for bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/usual_params.hpp"
#include "support/sim_specs.hpp"
#include "support/source.hpp"

namespace giga::test {
namespace {

SimSpec usual(int n_team_0, int n_team_1, bool hide) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  for (AgentSpec& agent : spec.agents) agent.idle_reward = hide ? 1.0f : 0.0f;
  spec.params.damage_cone_is_full = hide;
  spec.params.actions = ActionKind::discrete;
  spec.params.stochastic_communication = spec.params.stochastic_detection = true;
  spec.params.max_episode_length = 40;
  spec.maps[0].boxes = {{4, 4, 6, 6, 0, 10}};
  spec.params.reward_weight[static_cast<int>(RewardTerm::damage)] = 3;
  spec.finish();
  return spec;
}

/// One world that steps on and on, with parameters of either kind.
template <class P>
class OneWorld {
 public:
  explicit OneWorld(const SimSpec& spec)
      : tables_(spec, host_memory()),
        params_(tables_.params()),
        state_(params_.n_agents, 1, host_memory()),
        scratch_(host_memory(), ScratchLayout(params_).size) {
    for (int t = 0; t < kNTeams; ++t) {
      obs_[t].resize(static_cast<size_t>(params_.n_team[t] * VectorObservation::shape(params_).size()));
      reward_[t].resize(static_cast<size_t>(params_.n_team[t]));
      io_.team[t].obs[Observation::vector].rows = obs_[t].data();
      io_.team[t].reward = reward_[t].data();
    }
  }

  void run(const Jobs& jobs, const std::vector<int32_t> (&actions)[kNTeams]) {
    for (int t = 0; t < kNTeams; ++t) io_.team[t].action = actions[t].data();
    WorldView w = world_view(state_.view(), params_.n_agents, 0);
    attach_scratch(w, ScratchLayout(params_), scratch_.data());
    const auto draws_at = [](uint32_t step) { return PhiloxDraws(7, 0, step); };
    run_jobs(SerialLanes{}, jobs, params_, w, draws_at, io_, {OnDone::reset, 1}, 0);
  }

  std::vector<uint8_t> bytes() const {
    std::vector<uint8_t> all = state_.save();
    const auto add = [&all](const std::vector<float>& numbers) {
      const auto* from = reinterpret_cast<const uint8_t*>(numbers.data());
      all.insert(all.end(), from, from + numbers.size() * sizeof(float));
    };
    for (int t = 0; t < kNTeams; ++t) {
      add(obs_[t]);
      add(reward_[t]);
    }
    return all;
  }

 private:
  SimTables tables_;
  P params_;
  SimState state_;
  Buffer<char> scratch_;
  std::vector<float> obs_[kNTeams], reward_[kNTeams];
  StepIo io_;
};

/// The spec that a UsualParams is for.
template <class P>
SimSpec usual() {
  return usual(P::kTeam0, P::kTeam1, P::has_idle_reward);
}

template <class P>
void expect_the_same() {
  const SimSpec spec = usual<P>();
  OneWorld<SimParams> plain(spec);
  ASSERT_TRUE(P::fits(spec.params));
  OneWorld<P> constants(spec);
  std::vector<int32_t> actions[kNTeams];
  for (int t = 0; t < kNTeams; ++t) actions[t].assign(static_cast<size_t>(P::size_of(t)), 13);
  plain.run(jobs_of_start({}), actions);
  constants.run(jobs_of_start({}), actions);
  ASSERT_EQ(plain.bytes(), constants.bytes());
  const std::vector<uint8_t> first = plain.bytes();
  for (int step = 0; step < 100; ++step) {  // more than two episodes
    for (int t = 0; t < kNTeams; ++t)
      for (size_t k = 0; k < actions[t].size(); ++k) actions[t][k] = (step * 7 + static_cast<int>(k) * 5 + t) % 27;
    plain.run(jobs_of_step({OnDone::reset, 1}, {}), actions);
    constants.run(jobs_of_step({OnDone::reset, 1}, {}), actions);
    ASSERT_EQ(plain.bytes(), constants.bytes()) << "step " << step;
  }
  EXPECT_NE(plain.bytes(), first);
}

TEST(SimStaticParams, AStepWithConstantsIsTheSame) {
  expect_the_same<UsualParams<2>>();
  expect_the_same<UsualParams<3>>();
  expect_the_same<UsualParams<10>>();
  expect_the_same<UsualParams<20>>();
  expect_the_same<UsualParams<1>>();
  expect_the_same<UsualParams<5, 1>>();
  expect_the_same<UsualParams<5, 3>>();
  expect_the_same<UsualParams<3, 5>>();
  expect_the_same<UsualParams<10, 3>>();
  expect_the_same<UsualParams<20, 5>>();
  expect_the_same<UsualParams<5, 10, Play::hide_and_seek>>();
}

// Agents on a coarse lattice: most distances occur several times, and agents on top of each other.
template <class P>
int rank_on_a_lattice(uint32_t seed) {
  constexpr int kAgents = P::kAgents, kRows = P::n_neighbors;
  const SimSpec spec = usual<P>();
  const P p(spec.params);
  std::vector<float> x(kAgents), y(kAgents), distance(kAgents * kRows);
  std::vector<uint16_t> rows(kAgents * kRows), expected;
  std::vector<uint32_t> seen(static_cast<size_t>(kAgents * words_for(kAgents)));
  const auto draw = [&seed] { return seed = seed * 1664525u + 1013904223u, seed >> 16; };
  for (int i = 0; i < kAgents; ++i) {
    x[static_cast<size_t>(i)] = static_cast<float>(draw() % 5) * 0.7f;
    y[static_cast<size_t>(i)] = static_cast<float>(draw() % 5) * 0.7f;
    for (int a = 0; a < kAgents; ++a)
      if (draw() % 4 > 0) seen[static_cast<size_t>(i * words_for(kAgents) + a / 32)] |= 1u << (a & 31);
  }
  WorldView w{};
  w.x = x.data();
  w.y = y.data();
  w.seen = seen.data();
  w.neighbors = rows.data();
  w.neighbor_distance = distance.data();
  const SimParams& plain = p;
  for (int e = 0; e < kAgents; ++e) rank_neighbors(plain, w, e);
  expected.assign(kAgents * kRows, 0);
  expected.swap(rows);
  w.neighbors = rows.data();
  for (int e = 0; e < kAgents; ++e) rank_neighbors(p, w, e);
  EXPECT_EQ(rows, expected);
  return static_cast<int>(std::count(rows.begin(), rows.end(), kNobody));
}

TEST(SimStaticParams, EqualDistancesAreRankedByIndex) {
  int nobody = 0;
  for (uint32_t seed = 0; seed < 20; ++seed)
    nobody += rank_on_a_lattice<UsualParams<2>>(seed) + rank_on_a_lattice<UsualParams<5>>(seed) +
              rank_on_a_lattice<UsualParams<10>>(seed) + rank_on_a_lattice<UsualParams<20>>(seed) +
              rank_on_a_lattice<UsualParams<1>>(seed) + rank_on_a_lattice<UsualParams<10, 3>>(seed) +
              rank_on_a_lattice<UsualParams<20, 5>>(seed);
  EXPECT_GT(nobody, 0);
}

bool has_usual_params(const SimParams& params) {
  bool usual = false;
  with_usual_params<true>(params, [&]<class P>(const P&) { usual = P::kTeam > 0; });
  return usual;
}

TEST(SimStaticParams, ServeTheScenarios) {
  for (const char* name :
       {"identical_1_vs_1",   "identical_2_vs_2",     "identical_5_vs_5",      "identical_10_vs_10",
        "identical_20_vs_20", "identical_5_vs_1",     "identical_5_vs_3",      "identical_10_vs_3",
        "identical_20_vs_5",  "special_5_vs_1",       "special_5_vs_5",        "special_10_vs_3",
        "special_20_vs_5",    "hide_and_seek_5_vs_5", "hide_and_seek_10_vs_5", "hide_and_seek_5_vs_10",
        "waypoint_5_vs_5",    "waypoint_5_vs_3",      "waypoint_3_vs_3",       "identical_5_vs_5_published"})
    EXPECT_TRUE(has_usual_params(compile(load_scenario(name, {source_path()})).params)) << name;
}

// Where terms of the reward have factors, the constants of all other scenarios do not hold.
TEST(SimStaticParams, DoNotServeTermsWithFactors) {
  SimParams params = compile(load_scenario("identical_5_vs_5", {source_path()})).params;
  EXPECT_TRUE(has_usual_params(params));
  params.has_term_factors = true;
  EXPECT_FALSE(has_usual_params(params));
}

// Beside images the original orders rows by pixels, which the code with constants does not.
TEST(SimStaticParams, ServeTheOriginalsRulesWithoutImages) {
  SimParams params = compile(load_scenario("identical_5_vs_5_published", {source_path()})).params;
  params.rules = Rules::original;
  EXPECT_TRUE(has_usual_params(params));
  params.resolution = 84;
  EXPECT_FALSE(has_usual_params(params));
  params.rules = Rules::corrected;
  EXPECT_TRUE(has_usual_params(params));
}

}  // namespace
}  // namespace giga::test
