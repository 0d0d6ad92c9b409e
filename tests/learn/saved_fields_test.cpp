// Every saved field matters: disturbed, it is loaded as disturbed, and the run that goes on is another one.
#include <gtest/gtest.h>

#include "io/state_hash.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

/// Settings under which a learner saves all that it can.
std::vector<SmallRun> runs() {
  SmallRun plain, continuous;
  plain.scenario = "waypoints: {enable_waypoints: true}\nmaps: all\n";
  continuous.mappo = "obs_norm: true";
  continuous.critic = "kind: state, hidden: [16, 12]";
  continuous.scenario = "action: continuous\n";
  return {plain, continuous};
}

template <class T>
void change_each(NamedArray& array, T (*change)(T)) {
  for (size_t at = 0; at + sizeof(T) <= array.bytes.size(); at += sizeof(T)) {
    T value;
    std::memcpy(&value, &array.bytes[at], sizeof value);
    value = change(value);
    std::memcpy(&array.bytes[at], &value, sizeof value);
  }
}

/// Changes every number of an array to another valid one.
void disturb(NamedArray& array) {
  switch (array.type) {
    case ArrayType::f32:
      return change_each<float>(array, [](float x) { return x + 0.25f; });
    case ArrayType::f64:
      return change_each<double>(array, [](double x) { return x + 0.25; });
    case ArrayType::i32:
      return change_each<int32_t>(array, [](int32_t x) { return x ^ 1; });
    case ArrayType::i64:
      return change_each<int64_t>(array, [](int64_t x) { return x + 1; });
    case ArrayType::u8:
      return change_each<uint8_t>(array, [](uint8_t x) { return static_cast<uint8_t>(x ^ 1); });
  }
}

TEST(LearnSavedFields, EachIsLoadedAndChangesTheRun) {
  for (const SmallRun& run : runs()) {
    const auto learner = run.learner();
    for (int u = 0; u < 2; ++u) learner->update();
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
    for (size_t k = 0; k < checkpoint.size(); ++k) {
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
  const auto learner = SmallRun{}.learner();
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
