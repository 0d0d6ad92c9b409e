// The work of the fused update divided: among threads it changes no bit, among ranks the gradients are those of one.
#include <c10/core/impl/VirtualGuardImpl.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <string>
#include <utility>
#include <vector>

#include "fused_cases.hpp"
#include "learn/mappo/fused_update.hpp"

namespace giga::test {
namespace {

/// Critics on observations and of the true state.
std::vector<FusedCase> shared_cases() {
  std::vector<FusedCase> some;
  for (FusedCase c : fused_cases()) {
    c.clip = kClip;
    for (const char* name : {"Shipped", "BroadestCriticNarrowActor", "StateUneven"})
      if (c.name == std::string(name)) some.push_back(c);
  }
  return some;
}

void expect_that_threads_change_no_bit(const FusedCase& c) {
  std::vector<at::Tensor> found[3];
  for (int k = 0; k < 3; ++k) {
    FusedSetting s(c, kCpu, k + 1);
    FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for);
    FusedSteps steps(s);
    at::NoGradGuard no_grad;
    fused.begin_epoch(s.inputs(), s.alive, s.states, 1, s.advantage);
    fused.compute_gradients(0, s.policy_loss(), s.value_loss());
    fused.add_up(steps.of(s));
    const at::Tensor values = at::empty({s.n_states, c.n}, s.obs.options());
    fused.write_values(s.seen(), s.alive, {}, values);
    found[k] = {s.actor.parameters().gradient(), s.critic.parameters().gradient(), values};
    for (size_t x = 0; x < found[k].size(); ++x) EXPECT_TRUE(at::equal(found[k][x], found[0][x])) << k + 1 << ", " << x;
  }
}

// One thread, two, and three, which share the 16 parts of a minibatch unevenly.
TEST(LearnFusedUpdateThreads, ChangeNoBit) {
  ASSERT_EQ(shared_cases().size(), 3u);
  for (const FusedCase& c : shared_cases()) {
    SCOPED_TRACE(c.name);
    expect_that_threads_change_no_bit(c);
  }
}

/// The sum over two ranks that have the same rows: twice what is here.
void add_the_same(const at::Tensor& x, void* stream) {
  if (!x.is_cuda() || !stream) {
    x.mul_(2);
    return;
  }
  const c10::impl::VirtualGuardImpl cuda(at::kCUDA);
  const c10::Stream there(c10::Stream::UNSAFE, x.device(), reinterpret_cast<c10::StreamId>(stream));
  const c10::Stream before = cuda.exchangeStream(there);
  x.mul_(2);
  cuda.exchangeStream(before);
}

/// Two ranks with the same rows have the gradients of one, and twice the sums of diagnostics.
void expect_those_of_one_rank(const FusedCase& c, Device device) {
  std::vector<at::Tensor> found[2];
  std::vector<std::pair<int64_t, void*>> messages;
  for (int k = 0; k < 2; ++k) {
    FusedSetting s(c, device);
    SumOverRanks sum;
    if (k == 1)
      sum.add = [&](const at::Tensor& x, void* stream) {
        messages.emplace_back(x.numel(), stream);
        add_the_same(x, stream);
      };
    FusedUpdate fused(s.actor, s.critic, c.n, s.parallel_for, sum);
    FusedSteps steps(s);
    at::NoGradGuard no_grad;
    fused.begin_epoch(s.inputs(), s.alive, s.states, 1, s.advantage);
    fused.compute_gradients(0, s.policy_loss(), s.value_loss());
    fused.add_up(steps.of(s));
    fused.end_epoch();
    found[k] = {s.actor.parameters().gradient().cpu(), s.critic.parameters().gradient().cpu(), fused.sums().cpu()};
  }
  for (size_t x = 0; x < 2; ++x) {
    const double most = found[0][x].abs().max().item<double>();
    EXPECT_GT(most, 0);
    EXPECT_LT((found[1][x] - found[0][x]).abs().max().item<double>(), 1e-5 * most) << x;
  }
  EXPECT_TRUE(at::allclose(found[1][2], 2 * found[0][2], 1e-5));
  // One for the moments of the epoch, one for both gradients with their sums.
  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[1].first, found[0][0].numel() + found[0][1].numel() + 2 * kFusedSums);
  EXPECT_EQ(messages[1].second != nullptr, device.is_cuda());
}

TEST(LearnFusedUpdateRanks, HaveTheGradientsOfOne) {
  for (const FusedCase& c : shared_cases()) expect_those_of_one_rank(c, kCpu);
}
TEST(LearnFusedUpdateRanksGpu, HaveTheGradientsOfOne) {
  if (const std::string why = no_fused_kernels(); !why.empty()) GTEST_SKIP() << why;
  for (const FusedCase& c : shared_cases()) expect_those_of_one_rank(c, kOneGpu);
}

}  // namespace
}  // namespace giga::test
