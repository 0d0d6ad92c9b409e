// Which worlds find their pairs by place and which by tables (Pairs), and that this changes no number.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "parity/cases.hpp"
#include "sim/simulator.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

SimSpec agents(int n_team_0, int n_team_1) {
  SimSpec spec = plain_spec(n_team_0, n_team_1);
  spec.finish();
  return spec;
}
bool places(const SimSpec& spec, Pairs pairs) { return finds_by_place(spec, {.pairs = pairs}); }

TEST(PairsOfAgents, AreFoundByPlaceWhereThatPays) {
  const SimSpec few = agents(50, 49), many = agents(50, 50), most = agents(513, 512);
  EXPECT_FALSE(places(few, Pairs::automatic)) << "99 agents";
  EXPECT_TRUE(places(many, Pairs::automatic)) << "100";
  EXPECT_FALSE(places(agents(65, 62), Pairs::automatic)) << "127, of whom 65 may fire at one";
  EXPECT_TRUE(places(agents(64, 63), Pairs::automatic));
  EXPECT_TRUE(places(agents(65, 63), Pairs::automatic)) << "128";
  EXPECT_TRUE(places(few, Pairs::by_place));
  EXPECT_FALSE(places(many, Pairs::tables));
  EXPECT_TRUE(places(most, Pairs::tables)) << "1,025 agents have no tables";
  SimSpec drawn = many;
  drawn.params.resolution = 84;
  EXPECT_FALSE(places(drawn, Pairs::automatic)) << "images need tables";
}

/// 130 agents in five worlds, in the variants of the other tests of parity.
void play_both(Device device) {
  for (int variant = 0; variant < 4; ++variant) {
    SimSpec spec = variant_spec(7000, 70, 60, variant);
    spec.finish();
    SimOptions options = variant_options(0xABCDEF, 5, variant);
    options.n_threads = variant % 2 == 0 ? 2 : 3;  // five worlds are several for each thread, or too few for that
    options.pairs = Pairs::tables;
    SimRunner tables(make_simulator(spec, options, Device{}));
    options.pairs = Pairs::automatic;
    SimRunner by_place(make_simulator(spec, options, device));
    EXPECT_FALSE(tables.sim().state().shape().lists());
    ASSERT_TRUE(by_place.sim().state().shape().lists());
    tables.start();
    by_place.start();
    for (uint64_t k = 0; k < 12; ++k) {
      tables.step(k);
      by_place.step(k);
      Snapshot expected = tables.snapshot();
      std::erase_if(expected.fields, [](const auto& f) { return f.name == "detected" || f.name == "seen"; });
      ASSERT_EQ(difference(expected, by_place.snapshot()), "") << "variant " << variant << ", step " << k;
    }
    EXPECT_EQ(tables.sim().take_stats().rows, by_place.sim().take_stats().rows);
  }
}
TEST(PairsOfAgents, ChangeNoNumber) { play_both(Device{}); }
TEST(GpuPairsOfAgents, ChangeNoNumber) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  play_both({Device::Kind::cuda, 0});
}

/// Loads what worlds of one way have saved in the midst of a fight into worlds of the other, and plays on with both.
void go_on(Pairs saved, Pairs loaded) {
  SimSpec spec = variant_spec(7000, 40, 30, 1);
  spec.params.damage_per_second = 0;  // so that many fire for long
  spec.finish();
  SimOptions options = variant_options(0xABCDEF, 3, 1);
  options.pairs = saved;
  SimRunner before(make_simulator(spec, options, Device{}));
  options.pairs = loaded;
  SimRunner after(make_simulator(spec, options, Device{}));
  before.start();
  after.start();
  for (uint64_t k = 0; k < 9; ++k) before.step(k);
  const std::vector<uint8_t> tracked = before.snapshot().field("tracked").bytes;
  EXPECT_GT(std::ranges::count_if(tracked, [](uint8_t count) { return count > 0; }), 10) << "some fire";
  NamedArrays arrays;
  before.sim().state().save("simulator/", arrays);
  after.sim().state().load("simulator/", arrays);
  // What is observed once more is what was observed.
  before.observe();
  after.observe();
  EXPECT_EQ(difference(observations(before.snapshot()), observations(after.snapshot())), "");
  for (uint64_t k = 9; k < 20; ++k) {
    before.step(k);
    after.step(k);
    const auto alike = [](Snapshot shot) {
      std::erase_if(shot.fields, [](const auto& f) { return f.name == "detected" || f.name == "seen"; });
      return shot;
    };
    ASSERT_EQ(difference(alike(before.snapshot()), alike(after.snapshot())), "") << "step " << k;
  }
}
TEST(PairsOfAgents, ASavedStateGoesOnInEitherWay) {
  go_on(Pairs::tables, Pairs::by_place);
  go_on(Pairs::by_place, Pairs::tables);
}

TEST(PairsOfAgents, MoreFireThanListsHoldIsRefused) {
  const SimSpec spec = agents(4, 4);
  const auto tables = make_simulator(spec, {.pairs = Pairs::tables}, Device{});
  std::fill_n(tables->state().view().tracked, 64, uint8_t{3});
  NamedArrays arrays;
  tables->state().save("", arrays);
  const auto lists = make_simulator(spec, {.pairs = Pairs::by_place, .most_shooters = 3}, Device{});
  try {
    lists->state().load("", arrays);
    ADD_FAILURE() << "8 fire at an agent, 3 are counted";
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(),
                 "in the checkpoint more than 3 opponents fire at an agent, as many as are counted by "
                 "place; go on with train.pairs: tables");
  }
}

TEST(PairsOfAgents, ImagesAreRefusedByPlace) {
  SimSpec spec = agents(4, 4);
  spec.params.resolution = 84;
  EXPECT_THROW(make_simulator(spec, {.pairs = Pairs::by_place}, Device{}), InputError);
}

}  // namespace
}  // namespace giga::test
