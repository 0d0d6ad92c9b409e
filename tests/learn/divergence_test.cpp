// What is not finite is named, stops the learning before any parameter changes, and its batch can be kept.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cuda/runtime.hpp"
#include "policy/actor.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Puts a value into one number of a saved array.
void poison(NamedArrays& arrays, const std::string& name, float value) {
  for (NamedArray& a : arrays)
    if (a.name == name) {
      std::memcpy(a.bytes.data(), &value, sizeof value);
      return;
    }
  FAIL() << "no array " << name;
}

/// Empty where all arrays whose names begin so are equal.
std::string difference_of(const NamedArrays& a, const NamedArrays& b, const std::string& prefix) {
  NamedArrays x, y;
  for (const NamedArray& array : a)
    if (array.name.starts_with(prefix)) x.push_back(array);
  for (const NamedArray& array : b)
    if (array.name.starts_with(prefix)) y.push_back(array);
  EXPECT_FALSE(x.empty()) << prefix;
  return difference(x, y);
}

struct Case {
  const char* array;   // that is poisoned
  const char* tensor;  // that is named for it
  int team;
  bool in_rollout;  // found before anything is learned
  const char* mappo = "";
};

void expect_divergence(const Case& c, Device device) {
  SCOPED_TRACE(c.array);
  SmallRun run;
  run.mappo = c.mappo;
  const auto learner = run.learner(device);
  learner->update();
  EXPECT_FALSE(learner->divergence().has_value());
  NamedArrays poisoned = saved(*learner);
  poison(poisoned, c.array, kNan);
  learner->load(poisoned);
  learner->update();
  const auto found = learner->divergence();
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->tensor, c.tensor);
  EXPECT_EQ(found->team, c.team);
  EXPECT_EQ(found->update, 2);
  EXPECT_EQ(found->minibatch == 0, c.in_rollout);
  // The team has learned nothing from it.
  const std::string team = cat("team_", c.team, "/");
  for (const char* part : {"actor/mlp", "critic", "actor_adam", "critic_adam"})
    EXPECT_EQ(difference_of(poisoned, saved(*learner), team + part), "");

  NamedArrays batch;
  learner->save_batch(batch);
  const NamedArray& index = find_array(batch, "batch/index");
  ASSERT_EQ(index.shape.size(), 1u);
  EXPECT_GT(index.shape[0], 0);
  EXPECT_LE(index.shape[0], 24 * 8 / 4) << "at most one minibatch of 24 worlds x 8 steps";
  for (const char* name : {"batch/obs", "batch/action", "batch/log_prob", "batch/reward", "batch/advantage"})
    EXPECT_EQ(find_array(batch, name).shape.at(0), index.shape[0]) << name;
}

const Case kCases[] = {
    {"simulator/x", "observations", 0, true},
    {"team_1/actor/mlp/0/weight", "log-probabilities of actions", 1, true},
    {"team_0/critic/team_mlp/0/weight", "values", 0, true},
    {"team_1/value_norm/mean", "values", 1, true},
    // Of one policy the steps of the other team would move it.
    {"team_0/critic/team_mlp/0/weight", "values", 0, true, "one_policy: true"},
    {"team_1/critic/team_mlp/0/weight", "values", 1, true, "one_policy: true"},
    {"team_1/critic/team_mlp/0/weight", "values", 1, true, "one_policy: true, fused: false"},
};

TEST(LearnDivergence, IsNamedByTheFirstTensor) {
  for (const Case& c : kCases) expect_divergence(c, Device{});
}

TEST(LearnDivergenceGpu, IsNamedByTheFirstTensor) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  for (const Case& c : kCases) expect_divergence(c, {Device::Kind::cuda, 0});
}

// Step sizes that throw the parameters out of range: the first minibatch is still fine, a later one is not.
TEST(LearnDivergence, AGradientIsNamedWithItsMinibatch) {
  SmallRun run;
  run.mappo = "learning_rate: 1.0e+38, critic_learning_rate: 1.0e+38";
  const auto learner = run.learner();
  learner->update();
  const auto found = learner->divergence();
  ASSERT_TRUE(found.has_value());
  EXPECT_TRUE(found->tensor.starts_with("gradient of the ")) << found->tensor;
  EXPECT_EQ(found->update, 1);
  EXPECT_GT(found->minibatch, 1);
  EXPECT_LE(found->minibatch, 2 * 4);  // 2 epochs of 4 minibatches
  NamedArrays batch;
  learner->save_batch(batch);
  EXPECT_EQ(find_array(batch, "batch/index").shape, (std::vector<int64_t>{24 * 8 / 4}));
  expect_finite(batch);
}

TEST(LearnDivergence, AHealthyUpdateHasNoneAndNoBatch) {
  const auto learner = SmallRun{}.learner();
  learner->update();
  EXPECT_FALSE(learner->divergence().has_value());
  NamedArrays batch;
  learner->save_batch(batch);
  EXPECT_TRUE(batch.empty());
}

}  // namespace
}  // namespace giga::test
