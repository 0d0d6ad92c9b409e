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
  const SimSpec few = agents(64, 63), many = agents(64, 64), most = agents(513, 512);
  EXPECT_FALSE(places(few, Pairs::automatic)) << "127 agents";
  EXPECT_TRUE(places(many, Pairs::automatic)) << "128";
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

// What a run of an older program has saved has tables: how it goes on is said.
TEST(PairsOfAgents, ASavedStateSaysWhichItHas) {
  const SimSpec spec = agents(64, 64);
  const auto state_of = [&](Pairs pairs) { return make_simulator(spec, {.pairs = pairs}, Device{}); };
  const auto refusal = [&](Pairs saved, Pairs loaded) -> std::string {
    NamedArrays arrays;
    state_of(saved)->state().save("simulator/", arrays);
    try {
      state_of(loaded)->state().load("simulator/", arrays);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(Pairs::tables, Pairs::automatic),
            "the worlds of the checkpoint have tables of pairs; go on with train.pairs: tables");
  EXPECT_EQ(refusal(Pairs::by_place, Pairs::tables),
            "the worlds of the checkpoint have their pairs by place; go on with train.pairs: by_place");
  EXPECT_EQ(refusal(Pairs::by_place, Pairs::automatic), "");
  EXPECT_EQ(refusal(Pairs::tables, Pairs::tables), "");
}

}  // namespace
}  // namespace giga::test
