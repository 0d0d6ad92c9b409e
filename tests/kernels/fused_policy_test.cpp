// The kernel of the fused policy as PTX, thread by thread on a CPU, against what does the same in fp32
// (policy/cpu_kernels.hpp).
#include "cuda/fused_policy.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "kernels/ptx_files.hpp"
#include "kernels/ptx_module.hpp"
#include "kernels/setting.hpp"
#include "policy/cpu_kernels.hpp"

namespace giga::test {
namespace {

constexpr int kPolicyThreads = 256;
/// The kernels that take two policies at a time: those of few rows, of which a warp has so many numbers of a layer, and
/// that of a warp for rows.
struct PairKernel {
  std::vector<std::string> name;
  int threads;
  std::string what() const { return name.back(); }
};
std::vector<PairKernel> pair_kernels(const PolicyShape& shape) {
  const std::string of = cat("ILi", shape.in, "ELi", shape.hidden, "E");
  std::vector<PairKernel> kernels;
  if (shape.in == PolicyShape::kCrowdInput)
    kernels.push_back({{cat("warp_rows_kernelILi", shape.in, "E")}, 320});
  else
    kernels.push_back({{"few_rows_kernel" + of, "FewRowsE0"}, shape.hidden / 16 * 32});
  if (shape.hidden > FusedMlp::kNarrowHidden) return kernels;
  for (const char* way : {"FewRowsE1", "FewRowsE2"})
    kernels.push_back({{"few_rows_kernel" + of, way}, shape.hidden / 8 * 32});
  return kernels;
}

/// The kernel of many rows that are copied 16 bytes at a time, for such rows: those of a setting, with a NaN wherever
/// it reads nothing.
struct StreamedKernel {
  static constexpr int kThreads = 256;
  std::string name;  // empty: none serves
  std::vector<float> obs;
  int64_t stride = 0;

  StreamedKernel(const Setting& s, int64_t rows) : stride((s.c.input + 3) / 4 * 4 + 4) {
    if (!s.actor.is_narrow() || s.c.normalize || s.c.input > 144) return;  // fewer than it is used for, too
    name = "streamed_policy_kernel";
    obs.resize(static_cast<size_t>(rows * stride), NAN);
    for (int64_t row = 0; row < rows; ++row)
      std::copy_n(s.obs.begin() + row * s.stride, s.c.input, obs.begin() + row * stride);
  }
  FusedPolicy with_rows(FusedPolicy policy) const {
    policy.obs = obs.data();
    policy.obs_stride = stride;
    return policy;
  }
};

/// What a policy leaves of each row.
struct Acts {
  std::vector<int32_t> action;
  std::vector<float> pre_tanh, squashed, log_prob;

  explicit Acts(int64_t rows)
      : action(static_cast<size_t>(rows), -1),
        pre_tanh(static_cast<size_t>(rows) * kActionSize, NAN),
        squashed(pre_tanh),
        log_prob(static_cast<size_t>(rows), NAN) {}
};

constexpr const char* kNoKernels = "the build has no CUDA, and so no kernels";

class FusedPolicyAsPtx : public testing::TestWithParam<KernelCase> {};

TEST_P(FusedPolicyAsPtx, DrawsTheSameActions) {
  if (!has_ptx()) GTEST_SKIP() << kNoKernels;
  const Setting s(GetParam());
  const KernelCase& c = s.c;
  const std::vector<uint32_t> draw_step(static_cast<size_t>(s.n_rows() / c.n), 3);
  const RowDraws draws{draw_step.data(), 5, 0, c.n, 0};
  const auto policy_for = [&](Acts& acts) {
    FusedPolicy policy{.net = s.actor,
                       .rows_per_group = s.n_rows(),
                       .parameters = s.actor_values.data(),
                       .obs = s.obs.data(),
                       .obs_stride = s.stride,
                       .obs_limit = 10,
                       .actions = c.continuous ? ActionKind::continuous : ActionKind::discrete,
                       .discrete = {nullptr, draws, acts.action.data(), acts.log_prob.data()},
                       .continuous = {nullptr, s.actor_values.data() + s.actor.log_std, draws, acts.pre_tanh.data(),
                                      acts.squashed.data(), acts.log_prob.data()}};
    if (c.normalize) {
      policy.obs_mean = s.obs_mean.data();
      policy.obs_std = s.obs_std.data();
    }
    return policy;
  };
  Acts expected(s.n_rows());
  run_fused_policy(policy_for(expected), ThreadPool(1));

  if (!FusedPolicy::serves(s.actor)) GTEST_SKIP() << "LibTorch plays wide networks on many numbers";
  const PolicyShape made_for(s.actor);
  const std::string shape = cat("ILi", made_for.in, "ELi", made_for.hidden, "E");
  std::vector<float> first;
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    Acts found(s.n_rows()), few(s.n_rows());
    const PtxModule& kernels = ptx_module("fused_policy");
    kernels.launch({"policy_kernel" + shape}, {c.blocks}, kPolicyThreads, kSharedBytes, policy_for(found), order);
    if (const StreamedKernel streamed(s, s.n_rows()); !streamed.name.empty()) {
      Acts many(s.n_rows());
      kernels.launch({streamed.name}, {c.blocks}, StreamedKernel::kThreads, kSharedBytes,
                     streamed.with_rows(policy_for(many)), order);
      EXPECT_EQ(many.action, found.action);
      EXPECT_EQ(many.log_prob, found.log_prob);
      EXPECT_TRUE(!c.continuous || many.squashed == found.squashed);
    }
    // Two policies in one launch, each for all rows but what the other one has; a warp for each 16 numbers of a layer.
    if (!s.actor.is_wide()) {
      const int64_t worlds = s.n_rows() / c.n / 3, split = worlds * c.n;
      FusedPolicies both{{policy_for(few), policy_for(few)}};
      both.policy[0].rows_per_group = split;
      both.policy[1].rows_per_group = s.n_rows() - split;
      both.policy[1].obs += split * s.stride;
      both.policy[1].discrete.action += split;
      both.policy[1].discrete.log_prob += split;
      both.policy[1].continuous.pre_tanh_action += split * kActionSize;
      both.policy[1].continuous.action += split * kActionSize;
      both.policy[1].continuous.log_prob += split;
      both.policy[1].discrete.draws.first_world = both.policy[1].continuous.draws.first_world = worlds;
      const auto expect_found = [&](const PairKernel& kernel, const char* rows) {
        const Acts nothing(s.n_rows());  // into the same vectors, where `both` points to
        std::ranges::copy(nothing.action, few.action.begin());
        std::ranges::copy(nothing.log_prob, few.log_prob.begin());
        std::ranges::copy(nothing.squashed, few.squashed.begin());
        kernels.launch(kernel.name, {c.blocks, 1, 2}, kernel.threads, kSharedBytes, both, order);
        EXPECT_EQ(few.action, found.action) << kernel.what() << rows;
        EXPECT_EQ(few.log_prob, found.log_prob) << kernel.what() << rows;
        EXPECT_TRUE(!c.continuous || few.squashed == found.squashed) << kernel.what() << rows;
      };
      for (const PairKernel& kernel : pair_kernels(made_for)) expect_found(kernel, "");
      if (const StreamedKernel streamed(s, s.n_rows()); !streamed.name.empty()) {
        for (FusedPolicy& policy : both.policy) policy = streamed.with_rows(policy);
        both.policy[1].obs += split * streamed.stride;
        for (const PairKernel& kernel : pair_kernels(made_for)) expect_found(kernel, ", rows of whole pieces");
      }
    }
    // A draw that falls between two actions may go to the other one.
    int64_t others = 0;
    for (size_t row = 0; row < found.log_prob.size(); ++row) {
      ASSERT_FALSE(std::isnan(found.log_prob[row])) << row;
      if (!c.continuous && found.action[row] != expected.action[row])
        ++others;
      else
        EXPECT_NEAR(found.log_prob[row], expected.log_prob[row], 0.02) << row;
      for (size_t k = row * kActionSize; c.continuous && k < (row + 1) * kActionSize; ++k) {
        EXPECT_NEAR(found.pre_tanh[k], expected.pre_tanh[k], 0.01) << row;
        EXPECT_NEAR(found.squashed[k], std::tanh(found.pre_tanh[k]), 1e-6) << row;
      }
    }
    EXPECT_LT(others, s.n_rows() / 50) << "of " << s.n_rows();
    if (order == ThreadOrder::forward) first = found.log_prob;
    EXPECT_EQ(found.log_prob, first) << "the order of threads " << static_cast<int>(order);
  }
}

// Three groups of as many rows, with networks, moments of observations and deviations of their own, an odd number of
// numbers apart; the most likely action where actions are discrete. On a CPU they act as each would alone. Where the
// second does not play, the others act as before.
TEST_P(FusedPolicyAsPtx, GroupsActByTheirOwnNetworks) {
  const Setting s(GetParam());
  const KernelCase& c = s.c;
  constexpr int kGroups = 3;
  const int64_t worlds = s.n_rows() / c.n / kGroups, rows = worlds * c.n, size = std::ssize(s.actor_values);
  const int64_t stride = (size + 2 * c.input) | 1;
  std::vector<float> values(static_cast<size_t>(kGroups * stride), NAN);
  for (int group = 0; group < kGroups; ++group) {
    auto put = [&, to = values.begin() + group * stride](const std::vector<float>& from) mutable {
      to = std::transform(from.begin(), from.end(), to,
                          [&](float x) { return x * (1 - 0.3f * static_cast<float>(group)); });
    };
    put(s.actor_values);
    put(s.obs_mean);
    put(s.obs_std);
  }
  const std::vector<uint32_t> draw_step(static_cast<size_t>(kGroups * worlds), 3);
  const RowDraws draws{draw_step.data(), 5, 0, c.n, 0};
  constexpr uint8_t kPlays[kGroups] = {1, 0, 1};
  const auto policy_for = [&](Acts& acts, const uint8_t* plays = nullptr) {
    return FusedPolicy{.net = s.actor,
                       .groups = kGroups,
                       .rows_per_group = rows,
                       .parameters = values.data(),
                       .group_stride = stride,
                       .obs = s.obs.data(),
                       .obs_stride = s.stride,
                       .obs_mean = c.normalize ? values.data() + size : nullptr,
                       .obs_std = c.normalize ? values.data() + size + c.input : nullptr,
                       .obs_limit = 10,
                       .actions = c.continuous ? ActionKind::continuous : ActionKind::discrete,
                       .discrete = {nullptr, draws, acts.action.data(), acts.log_prob.data(), true},
                       .continuous = {nullptr, values.data() + s.actor.log_std, draws, acts.pre_tanh.data(),
                                      acts.squashed.data(), acts.log_prob.data()},
                       .plays = plays};
  };
  const auto expect_same = [&](const Acts& a, const Acts& b, const char* what) {
    EXPECT_EQ(a.log_prob, b.log_prob) << what;
    EXPECT_TRUE(c.continuous ? a.pre_tanh == b.pre_tanh && a.squashed == b.squashed : a.action == b.action) << what;
  };
  const auto expect_two = [&](Acts two, const Acts& all, const char* what) {
    for (auto row = static_cast<size_t>(rows); row < static_cast<size_t>(2 * rows); ++row) {
      EXPECT_EQ(two.action[row], -1) << what;
      EXPECT_TRUE(std::isnan(two.log_prob[row]) && std::isnan(two.squashed[row * kActionSize])) << what;
      two.action[row] = all.action[row];
      two.log_prob[row] = all.log_prob[row];
      for (size_t k = row * kActionSize; k < (row + 1) * kActionSize; ++k) {
        two.pre_tanh[k] = all.pre_tanh[k];
        two.squashed[k] = all.squashed[k];
      }
    }
    expect_same(two, all, what);
  };
  Acts expected(kGroups * rows), alone(kGroups * rows), found(kGroups * rows), few(kGroups * rows);
  Acts two(kGroups * rows);
  run_fused_policy(policy_for(expected), ThreadPool(1));
  run_fused_policy(policy_for(two, kPlays), ThreadPool(1));
  expect_two(two, expected, "on a CPU");
  for (int group = 0; group < kGroups; ++group) {
    FusedPolicy one = policy_for(alone);
    one.groups = 1;
    one.parameters += group * stride;
    one.obs += group * rows * s.stride;
    if (c.normalize) {
      one.obs_mean += group * stride;
      one.obs_std += group * stride;
    }
    one.discrete.action += group * rows;
    one.discrete.log_prob += group * rows;
    one.continuous.log_std += group * stride;
    one.continuous.pre_tanh_action += group * rows * kActionSize;
    one.continuous.action += group * rows * kActionSize;
    one.continuous.log_prob += group * rows;
    one.discrete.draws.first_world = one.continuous.draws.first_world = group * worlds;
    run_fused_policy(one, ThreadPool(1));
  }
  expect_same(alone, expected, "on a CPU");

  if (!has_ptx()) GTEST_SKIP() << kNoKernels;
  if (!FusedPolicy::serves(s.actor)) GTEST_SKIP() << "LibTorch plays wide networks on many numbers";
  const PolicyShape made_for(s.actor);
  const std::string shape = cat("ILi", made_for.in, "ELi", made_for.hidden, "E");
  const PtxModule& kernels = ptx_module("fused_policy");
  kernels.launch({"policy_kernel" + shape}, {c.blocks, kGroups}, kPolicyThreads, kSharedBytes, policy_for(found),
                 ThreadOrder::shuffled);
  two = Acts(kGroups * rows);
  kernels.launch({"policy_kernel" + shape}, {c.blocks, kGroups}, kPolicyThreads, kSharedBytes, policy_for(two, kPlays),
                 ThreadOrder::shuffled);
  expect_two(two, found, "policy_kernel");
  if (const StreamedKernel streamed(s, kGroups * rows); !streamed.name.empty()) {
    Acts many(kGroups * rows);
    const auto launch = [&](const FusedPolicy& policy) {
      kernels.launch({streamed.name}, {c.blocks, kGroups}, StreamedKernel::kThreads, kSharedBytes,
                     streamed.with_rows(policy), ThreadOrder::shuffled);
    };
    launch(policy_for(many));
    expect_same(many, found, "streamed");
    two = Acts(kGroups * rows);
    launch(policy_for(two, kPlays));
    expect_two(two, found, "streamed");
  }
  if (!s.actor.is_wide())
    for (const PairKernel& kernel : pair_kernels(made_for)) {
      few = Acts(kGroups * rows);
      const auto launch = [&](const FusedPolicy& policy) {
        kernels.launch(kernel.name, {c.blocks, kGroups}, kernel.threads, kSharedBytes, FusedPolicies{{policy}},
                       ThreadOrder::shuffled);
      };
      launch(policy_for(few));
      expect_same(few, found, kernel.what().c_str());
      two = Acts(kGroups * rows);
      launch(policy_for(two, kPlays));
      expect_two(two, found, kernel.what().c_str());
    }
  int64_t others = 0;
  for (size_t row = 0; row < found.log_prob.size(); ++row)
    if (!c.continuous && found.action[row] != expected.action[row])  // two that are nearly as likely
      ++others;
    else
      EXPECT_NEAR(found.log_prob[row], expected.log_prob[row], 0.02) << row;
  EXPECT_LE(others, kGroups * rows / 50) << "of " << kGroups * rows;
}

INSTANTIATE_TEST_SUITE_P(All, FusedPolicyAsPtx, testing::ValuesIn(observation_cases()),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
