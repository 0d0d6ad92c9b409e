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

class FusedPolicyAsPtx : public testing::TestWithParam<KernelCase> {
 protected:
  void SetUp() override {
    if (!has_ptx()) GTEST_SKIP() << "the build has no CUDA, and so no kernels";
  }
};

TEST_P(FusedPolicyAsPtx, DrawsTheSameActions) {
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
  const int hidden = s.actor.is_narrow() ? 64 : s.actor.is_wide() ? 256 : 128;
  const int input = c.input <= 64 ? 64 : c.input <= 128 ? 128 : c.input <= 160 && hidden == 64 ? 160 : 192;
  const std::string shape = cat("ILi", input, "ELi", hidden, "E");
  std::vector<float> first;
  for (const ThreadOrder order : {ThreadOrder::forward, ThreadOrder::backward, ThreadOrder::shuffled}) {
    Acts found(s.n_rows()), few(s.n_rows());
    const PtxModule& kernels = ptx_module("fused_policy");
    kernels.launch({"policy_kernel" + shape}, c.blocks, kPolicyThreads, kSharedBytes, policy_for(found), order);
    // Two policies in one launch, each for all rows but what the other one has; 16 rows for each of eight warps.
    const int64_t rows_of_block = 128, worlds = s.n_rows() / c.n / 3, split = worlds * c.n;
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
    kernels.launch({"few_rows_kernel" + shape}, static_cast<int>((s.n_rows() + rows_of_block - 1) / rows_of_block),
                   kPolicyThreads, kSharedBytes, both, order, 2);
    EXPECT_EQ(few.action, found.action);
    EXPECT_EQ(few.log_prob, found.log_prob);
    EXPECT_TRUE(!c.continuous || few.squashed == found.squashed);
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

INSTANTIATE_TEST_SUITE_P(All, FusedPolicyAsPtx, testing::ValuesIn(observation_cases()),
                         [](const auto& p) { return std::string(p.param.name); });

}  // namespace
}  // namespace giga::test
