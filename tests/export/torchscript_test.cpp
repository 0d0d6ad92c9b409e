// Modules that come from elsewhere: what they must take and give to play.
#include "export/torchscript.hpp"

#include <gtest/gtest.h>
#include <torch/script.h>

#include <sstream>

#include "io/temporary_folder.hpp"
#include "math/distributions.hpp"
#include "policies.hpp"
#include "policy/policy.hpp"

namespace giga::test {
namespace {

/// The bytes of a module whose forward has that body.
std::string module_with(const std::string& body, const at::Tensor& log_std = {}) {
  torch::jit::Module module("Stranger");
  if (log_std.defined()) module.register_buffer("log_std", log_std);
  module.define("def forward(self, obs: Tensor):\n    " + body + "\n");
  std::ostringstream out;
  module.save(out);
  return out.str();
}

std::string refusal(const std::string& bytes, ActionKind actions = ActionKind::discrete) {
  return input_error_of([&] { open_torchscript(bytes, "stranger.pt", kInputs, actions, {}); });
}

TEST(ExportTorchScript, AModuleFromElsewherePlays) {
  const ReadPolicy read =
      open_torchscript(module_with("return obs[:, 1:28]"), "stranger.pt", kInputs, ActionKind::discrete, {});
  const at::Tensor obs = random_observations(5), head = read.policy->forward(obs);
  ASSERT_EQ(head.sizes(), at::IntArrayRef({5, kLogitStride}));
  EXPECT_FALSE(read.greedy);
  EXPECT_TRUE(at::equal(head.slice(1, 0, kNDiscreteActions), obs.slice(1, 1, 28)));
}

TEST(ExportTorchScript, WithoutADeviationItPlaysItsMean) {
  const ReadPolicy plain =
      open_torchscript(module_with("return obs[:, :3]"), "stranger.pt", kInputs, ActionKind::continuous, {});
  EXPECT_TRUE(plain.greedy);
  const at::Tensor log_std = torch::tensor({-1.0f, 0.0f, 0.5f});
  const ReadPolicy random =
      open_torchscript(module_with("return obs[:, :3]", log_std), "stranger.pt", kInputs, ActionKind::continuous, {});
  EXPECT_FALSE(random.greedy);
  EXPECT_TRUE(at::equal(random.policy->log_std(), log_std));
}

TEST(ExportTorchScript, WhatDoesNotFitIsRefused) {
  EXPECT_TRUE(
      contains(refusal(module_with("return obs[:, :26]")),
               {"stranger.pt is no TorchScript module that can play here", "[2, 26]", "needed: Float [2, 27]"}));
  EXPECT_TRUE(contains(refusal(module_with("return obs[:, :27].double()")), {"Double [2, 27]"}));
  EXPECT_TRUE(contains(refusal(module_with("return obs[0, :27]")), {"[27]", "needed: Float [2, 27]"}));
  EXPECT_TRUE(contains(refusal(module_with("return 3")), {"stranger.pt is no TorchScript module"}));
  EXPECT_TRUE(contains(refusal(module_with("return torch.linear(obs, torch.zeros([27, 48]))")),
                       {"stranger.pt is no TorchScript module"}));
  EXPECT_TRUE(contains(refusal(module_with("return obs[:, :3]", at::zeros({2})), ActionKind::continuous),
                       {"log_std has shape [2]; needed: [3]"}));
}

}  // namespace
}  // namespace giga::test
