// Pure functions of lib/core and the draws: CPU against GPU, bit for bit.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "core/geometry.hpp"
#include "cuda/runtime.hpp"
#include "parity/device_functions.cuh"

namespace giga::test {

std::vector<float> functions_on_cpu(const std::vector<float>& angles) {
  std::vector<float> out(angles.size() * kNFunctions);
  for (size_t k = 0; k < angles.size(); ++k) evaluate_functions(angles[k], out.data() + k * kNFunctions);
  return out;
}

std::vector<float> draws_on_cpu(uint64_t seed, int n_worlds, uint32_t step) {
  std::vector<float> out(static_cast<size_t>(n_worlds) * kDrawsPerWorld);
  for (int w = 0; w < n_worlds; ++w)
    evaluate_draws(seed, static_cast<uint32_t>(w), step, out.data() + static_cast<size_t>(w) * kDrawsPerWorld);
  return out;
}

namespace {

/// A grid over [-100, 100], dense around the multiples of pi/2, and tiny numbers.
std::vector<float> test_angles() {
  std::vector<float> angles;
  for (int k = -100000; k <= 100000; ++k) angles.push_back(static_cast<float>(k) * 1e-3f);
  for (int quarter = -60; quarter <= 60; ++quarter) {
    float angle = static_cast<float>(quarter) * (kPi / 2);
    for (int k = 0; k < 20; ++k) angle = std::nextafter(angle, -1000.0f);
    for (int k = 0; k < 40; ++k, angle = std::nextafter(angle, 1000.0f)) angles.push_back(angle);
  }
  for (const float tiny : {1e-8f, 1e-20f, 1e-38f, 1e-42f}) {
    angles.push_back(tiny);
    angles.push_back(-tiny);
  }
  return angles;
}

TEST(GpuFunctions, AnglesAndRoots) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
#if GIGASTEP_HAS_CUDA
  const std::vector<float> angles = test_angles();
  const std::vector<float> expected = functions_on_cpu(angles), got = functions_on_gpu(angles);
  ASSERT_EQ(expected.size(), got.size());
  for (size_t k = 0; k < expected.size(); ++k)
    ASSERT_EQ(std::memcmp(&expected[k], &got[k], sizeof(float)), 0)
        << kFunctionNames[k % kNFunctions] << " of " << angles[k / kNFunctions] << ": CPU " << expected[k] << ", GPU "
        << got[k];
#endif
}

TEST(GpuFunctions, Draws) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
#if GIGASTEP_HAS_CUDA
  for (const uint32_t step : {0u, 1u, 4000000000u}) {
    const uint64_t seed = 0xDEADBEEF12345678ull;
    const std::vector<float> expected = draws_on_cpu(seed, 65, step), got = draws_on_gpu(seed, 65, step);
    ASSERT_EQ(expected.size(), got.size());
    for (size_t k = 0; k < expected.size(); ++k)
      ASSERT_EQ(expected[k], got[k]) << "world " << k / kDrawsPerWorld << ", draw " << k % kDrawsPerWorld;
  }
#endif
}

TEST(Functions, TestAnglesReachEveryBranch) {
  // The comparison above means something only if the angles are on both sides of each branch of fmod_two_pi.
  int below = 0, once = 0, beyond = 0;
  for (const float angle : test_angles()) {
    const float size = std::abs(angle);
    (size < kTwoPi ? below : size < 2 * kTwoPi ? once : beyond) += 1;
  }
  EXPECT_GT(below, 1000);
  EXPECT_GT(once, 1000);
  EXPECT_GT(beyond, 1000);
  EXPECT_EQ(functions_on_cpu({1.0f})[6], 1.0f);
  const std::vector<float> draws = draws_on_cpu(1, 65, 2);
  for (size_t w = 0; w < 65; ++w) EXPECT_LT(draws[w * kDrawsPerWorld + 25], 7.0f) << "map of world " << w;
}

}  // namespace
}  // namespace giga::test
