// Guests of the pool (opponents.policies): who is met, how a run goes on with them, and who cannot join.
#include "learn/opponents/guests.hpp"

#include <gtest/gtest.h>

#include "io/temporary_folder.hpp"
#include "learn/resume_config.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

class LearnGuests : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void save(const SmallRun& small, const std::string& name) const { test::save(small, path(name)); }

  TemporaryFolder folder_;
};

TEST_F(LearnGuests, StayInThePool) {
  SmallRun guest, run;
  guest.mappo = run.mappo = "obs_norm: true";
  save(guest, "guest.h5");
  const auto with = [&](const std::string& policies) {
    run.more = cat("opponents: {pool_size: 2, pool_every_updates: 1, pool_share: 0.5, policies: [", policies, "]}\n");
    return run.learner();
  };
  const auto rows = [](const NamedArrays& arrays, int team) {
    return array_values<int32_t>(find_array(arrays, cat("league/team_", team, "/row")));
  };
  const auto learner = with(cat("'", path("guest.h5"), "'"));
  // Row 3, behind a ring of two: from the first update on there is nobody else.
  for (const int team : {0, 1}) EXPECT_EQ(rows(saved(*learner), team), (std::vector<int32_t>{3, 3}));
  for (int k = 0; k < 2; ++k) expect_finite(learner->update(), 1);
  const NamedArrays checkpoint = saved(*learner);
  EXPECT_EQ(find_array(checkpoint, "league/team_0/guests").shape.at(0), 1);
  const Metrics metrics = learner->update();

  // A run goes on exactly, with the guests of its checkpoint, whatever has become of the file.
  const LoadedRun began = run.load();
  const LoadedRun resumed = resume_config(print_yaml(began.config, true), print_scenario(began.scenario), {}).run;
  SmallRun another = guest;
  another.seed = 8;
  save(another, "guest.h5");
  const auto again = make_learner(resumed, Device{});
  again->load(checkpoint);
  EXPECT_EQ(difference(again->update(), metrics), "");
  EXPECT_EQ(difference(saved(*again), saved(*learner)), "");

  // It goes on with others, of whom nothing is known, and without any.
  const auto other_guest = with(cat("'", path("guest.h5"), "'"));
  other_guest->load(checkpoint);
  const NamedArrays changed = saved(*other_guest);
  EXPECT_NE(find_array(changed, "league/team_0/guests").bytes, find_array(checkpoint, "league/team_0/guests").bytes);
  EXPECT_EQ(array_values<double>(find_array(changed, "league/team_0/games")).at(2), 0);
  for (const uint8_t began_since : find_array(changed, "league/counts").bytes) EXPECT_EQ(began_since, 0);
  const auto nobody = with("");
  nobody->load(checkpoint);
  for (const int32_t row : rows(saved(*nobody), 1)) EXPECT_LE(row, 2);
  // What cannot join is said before anything starts.
  SmallRun other = guest;
  other.actor = "hidden: [8]";
  save(other, "other.h5");
  EXPECT_TRUE(contains(input_error_of([&] { with(cat("'", path("other.h5"), "'")); }),
                       {"opponents.policies", "other.h5", "not like those of the run", "hidden is [8] there"}));
  SmallRun plain;
  save(plain, "plain.h5");
  EXPECT_TRUE(contains(input_error_of([&] { with(cat("'", path("plain.h5"), "'")); }),
                       {"plain.h5", "observations are normalised here and not there"}));
  SmallRun viewed = guest;
  viewed.scenario = "observation: {egocentric_view: true}\n";
  save(viewed, "viewed.h5");
  EXPECT_TRUE(contains(input_error_of([&] { with(cat("'", path("viewed.h5"), "'")); }),
                       {"opponents.policies", "viewed.h5", "egocentric_view"}));
  EXPECT_TRUE(contains(input_error_of([&] { with("./nobody.h5"); }), {"opponents.policies", "nobody.h5"}));
  // One that learned alone, as a best response does, stands for its own team only.
  SmallRun response = guest;
  response.train = "learning_team: 1, opponent: circle";
  save(response, "response.h5");
  const NamedArrays alone = saved(*with(cat("'", path("response.h5"), "'")));
  EXPECT_EQ(rows(alone, 0), (std::vector<int32_t>{0, 0}));
  EXPECT_EQ(rows(alone, 1), (std::vector<int32_t>{3, 3}));
}

}  // namespace
}  // namespace giga::test
