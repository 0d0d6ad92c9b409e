// A step whose parameters are constants of the compiler is the same step, bit for bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/usual_params.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

SimSpec usual(int n) {
  SimSpec spec = plain_spec(n, n);
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

template <int kTeam>
void expect_the_same(const SimSpec& spec) {
  OneWorld<SimParams> plain(spec);
  ASSERT_TRUE(UsualParams<kTeam>::fits(spec.params));
  OneWorld<UsualParams<kTeam>> constants(spec);
  std::vector<int32_t> actions[kNTeams];
  for (auto& team : actions) team.assign(kTeam, 13);
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
  expect_the_same<2>(usual(2));
  expect_the_same<3>(usual(3));
  expect_the_same<10>(usual(10));
  expect_the_same<20>(usual(20));
}

// Agents on a coarse lattice: most distances occur several times, and agents on top of each other.
template <int kTeam>
int rank_on_a_lattice(uint32_t seed) {
  constexpr int kAgents = 2 * kTeam, kRows = UsualParams<kTeam>::n_neighbors;
  const SimSpec spec = usual(kTeam);
  const UsualParams<kTeam> p(spec.params);
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
    nobody += rank_on_a_lattice<2>(seed) + rank_on_a_lattice<5>(seed) + rank_on_a_lattice<10>(seed) +
              rank_on_a_lattice<20>(seed);
  EXPECT_GT(nobody, 0);
}

}  // namespace
}  // namespace giga::test
