// Every saved field matters: disturbed, it is loaded as disturbed, and the run that goes on is another one.
#include <gtest/gtest.h>

#include "io/state_hash.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// Settings under which a learner saves all that it can.
std::vector<SmallRun> runs() {
  SmallRun plain, continuous, pool, memory, taught;
  plain.scenario = "waypoints: {enable_waypoints: true}\nmaps: all\n";
  continuous.mappo = "obs_norm: true";
  continuous.critic = "kind: state, hidden: [16, 12]";
  continuous.scenario = "action: continuous\n";
  // After three updates there is one past policy, which was drawn everywhere: a disturbed row is the present one, 0.
  pool.more = "opponents: {pool_size: 3, pool_every_updates: 2, pool_share: 0.5, pool_draw: pfsp}\n";
  memory.actor = "hidden: [8], memory: lstm, memory_size: 6";
  memory.critic = "hidden: [8], memory: gru, memory_size: 6";
  taught.actor = "encoder: impala, impala_width: 2, hidden: [8], activation: relu";
  taught.critic = "hidden: [8], inputs: egocentric";
  taught.mappo = "view_coef: 2";
  taught.scenario = "observation: {type: rgb_vector, resolution: 9, egocentric_view: true}\n";
  taught.n_threads = 1;
  return {plain, continuous, pool, memory, taught};
}

TEST(LearnSavedFields, EachIsLoadedAndChangesTheRun) {
  const auto stride = static_cast<size_t>(thinned(5));
  size_t first = 0;  // thinned: other fields of each run
  for (const SmallRun& run : runs()) {
    const auto learner = run.learner();
    for (int u = 0; u < 3; ++u) learner->update();
    const NamedArrays checkpoint = saved(*learner);
    EXPECT_GT(checkpoint.size(), 50u);
    const auto after_update = [&](const NamedArrays& arrays) {
      learner->load(arrays);
      const Metrics metrics = learner->update();
      std::string figures;
      for (const auto& [name, value] : metrics) figures += cat(name, ' ', value, '\n');
      return state_sha256(saved(*learner)) + figures;
    };
    const std::string undisturbed = after_update(checkpoint);
    EXPECT_EQ(after_update(checkpoint), undisturbed);
    for (size_t k = first++ % stride; k < checkpoint.size(); k += stride) {
      NamedArrays disturbed = checkpoint;
      disturb(disturbed[k]);
      learner->load(disturbed);
      EXPECT_EQ(state_sha256(saved(*learner)), state_sha256(disturbed)) << checkpoint[k].name << " is not loaded";
      EXPECT_NE(state_sha256(disturbed), state_sha256(checkpoint)) << checkpoint[k].name;
      // Who detects whom is found anew by each step before anybody asks; it is saved because the state is compared
      // whole.
      if (checkpoint[k].name == "simulator/detected") continue;
      EXPECT_NE(after_update(disturbed), undisturbed) << checkpoint[k].name << " makes no difference";
    }
  }
}

TEST(LearnSavedFields, AMissingOrMisshapenOneIsRefused) {
  SmallRun run;
  run.more = "opponents: {pool_size: 3, pool_share: 0.5}\n";
  const auto learner = run.learner();
  const NamedArrays checkpoint = saved(*learner);
  for (size_t k = 0; k < checkpoint.size(); ++k) {
    NamedArrays missing = checkpoint, shorter = checkpoint;
    missing.erase(missing.begin() + static_cast<std::ptrdiff_t>(k));
    EXPECT_THROW(learner->load(missing), InputError) << checkpoint[k].name;
    if (checkpoint[k].shape.empty() || checkpoint[k].shape[0] < 2) continue;
    NamedArray& a = shorter[k];
    a.bytes.resize(a.bytes.size() / static_cast<size_t>(a.shape[0]));
    a.shape[0] = 1;
    EXPECT_THROW(learner->load(shorter), InputError) << checkpoint[k].name;
  }
  EXPECT_NO_THROW(learner->load(checkpoint));
}

}  // namespace
}  // namespace giga::test
