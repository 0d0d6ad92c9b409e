#include "fused_cases.hpp"

#include <ATen/CPUGeneratorImpl.h>

#include <cmath>

#include "cuda/runtime.hpp"
#include "rollout/stream.hpp"
#include "sim/state_observation.hpp"

namespace giga::test {
namespace {

struct Normal {
  at::Device device;
  at::Tensor operator()(at::IntArrayRef shape, uint64_t seed) const {
    at::Generator generator = at::detail::createCPUGenerator(seed);
    return at::randn(shape, generator, at::TensorOptions().dtype(at::kFloat)).to(device);
  }
};

Precision precision(Device device) { return device.is_cuda() ? Precision::tf32 : Precision::fp32; }
InputColumns inputs_of(const FusedCase& c) { return {FusedSetting::kRow, c.first, c.columns}; }
ActorConfig actor_config(const FusedCase& c) {
  ActorConfig config;
  config.hidden = c.hidden;
  config.activation = c.activation;
  return config;
}
CriticShape critic_shape(const FusedCase& c) {
  CriticShape shape{.team = c.team, .inputs = inputs_of(c), .world_features = c.world};
  shape.n_team[c.team] = c.n;
  shape.n_team[1 - c.team] = c.n_other;
  return shape;
}
CriticConfig critic_config(const FusedCase& c) {
  CriticConfig config;
  config.kind = c.critic;
  config.hidden = c.critic_hidden.empty() ? c.hidden : c.critic_hidden;
  config.activation = c.activation;
  return config;
}

}  // namespace

Critic make_critic(const FusedCase& c, const ParallelFor& parallel_for, Device device) {
  return Critic(critic_config(c), critic_shape(c), precision(device), parallel_for, torch_device(device), 2);
}

FusedSetting::FusedSetting(const FusedCase& c, Device device, int n_threads)
    : n_states(c.n_states),
      actions(c.actions),
      parallel_for(device, n_threads, current_stream(device)),
      actor(actor_config(c), inputs_of(c), c.actions, c.normalize, precision(device), torch_device(device), 1),
      critic(make_critic(c, parallel_for, device)) {
  const Normal normal{torch_device(device)};
  at::NoGradGuard no_grad;
  actor.parameters().values().add_(0.1 * normal({actor.parameters().size()}, 3));
  critic.parameters().values().add_(0.1 * normal({critic.parameters().size()}, 4));
  obs = normal({n_states, c.n, kRow}, 5);
  alive = (normal({n_states, c.n}, 6) > -0.7).to(at::kByte);
  alive[0].zero_();  // a state in which nobody lives
  // Agents of both teams, and the world. The first number of an agent says whether it lives; those of the dead are 0.
  at::Tensor others = (normal({n_states, c.n_other}, 13) > -0.7).to(at::kFloat);
  others[1].zero_();  // a state in which none of the others lives
  const at::Tensor own = alive.to(at::kFloat);
  const at::Tensor living = at::cat(c.team == 0 ? std::vector{own, others} : std::vector{others, own}, 1).unsqueeze(2);
  at::Tensor agents = normal({n_states, c.n + c.n_other, kEntityFeatures}, 14);
  agents.select(2, 0).fill_(1);
  true_state = at::cat({(agents * living).flatten(1), normal({n_states, c.world}, 15)}, 1);
  if (c.normalize) actor.normalizer().update(obs.view({-1, kRow}) * 3 + 1, alive.to(at::kFloat).view({-1}));
  states = at::arange(n_states - n_states % 3 - 3, -1, -3, obs.options().dtype(at::kLong));
  action = (normal({n_states, c.n}, 7).abs() * 10).to(at::kInt).remainder(kNDiscreteActions);
  // Actions that the policy draws, and probabilities near its own: where they are far apart, the ratio makes rounding
  // larger, and single rows count more than all others.
  const at::Tensor head = actor.forward(obs.flatten(0, 1)).view({n_states, c.n, -1});
  if (c.actions == ActionKind::discrete) {
    log_prob = at::log_softmax(head.slice(-1, 0, kNDiscreteActions), -1)
                   .gather(-1, action.to(at::kLong).unsqueeze(-1))
                   .squeeze(-1);
  } else {
    const at::Tensor e = normal({n_states, c.n, 3}, 8);
    u = head + actor.log_std().exp() * e;
    const at::Tensor log_slope = 2 * (std::log(2.0) - u - at::softplus(-2 * u));
    log_prob = (-0.5 * e.square() - actor.log_std() - kHalfLogTwoPi - log_slope).sum(-1);
  }
  log_prob = log_prob + 0.3 * normal({n_states, c.n}, 9);
  advantage = 2 * normal({n_states, c.n}, 10) + 1;
  old_value = 0.3 * normal({n_states, c.n}, 11);
  returns = 4 + 2 * normal({n_states, c.n}, 12);
  mean = at::full({1}, 4.0f, obs.options());
  std = at::full({1}, 2.0f, obs.options());
  entropy_coef = at::full({1}, kEntropyCoef, obs.options());
  clip_coef = at::full({1}, c.clip, obs.options());
}

FusedPolicyLoss FusedSetting::policy_loss() const {
  FusedPolicyLoss loss{.old_log_prob = log_prob.const_data_ptr<float>(),
                       .advantage = advantage.const_data_ptr<float>(),
                       .entropy_coef = entropy_coef.const_data_ptr<float>(),
                       .clip_coef = clip_coef.const_data_ptr<float>()};
  if (actions == ActionKind::discrete)
    loss.action = action.const_data_ptr<int32_t>();
  else
    loss.pre_tanh_action = u.const_data_ptr<float>();
  return loss;
}

FusedValueLoss FusedSetting::value_loss() const {
  return {.old_value = old_value.const_data_ptr<float>(),
          .returns = returns.const_data_ptr<float>(),
          .value_mean = mean.const_data_ptr<float>(),
          .value_std = std.const_data_ptr<float>(),
          .value_coef = kValueCoef};
}

StepFlags FusedSteps::flags(int network) const {
  float* f = figures.data_ptr<float>();
  return {stop.const_data_ptr<float>(),
          f + kFirstFault + kFaultActorGradient + network,
          f + kFirstFault,
          kNFaults,
          number.const_data_ptr<float>(),
          f + kFigActorNorm + network};
}

FusedStep FusedSteps::of(const FusedSetting& s) const {
  const ParameterSet* parameters[2] = {&s.actor.parameters(), &s.critic.parameters()};
  FusedStep::Network network[2];
  for (int k = 0; k < 2; ++k)
    network[k] = {.gate = adam[k].gate(kMaxNorm, flags(k)),
                  .adam = adam[k].adam(*parameters[k], step_size.const_data_ptr<float>()),
                  .norm = adam[k].norm().data_ptr<float>()};
  return {.actor = network[0],
          .critic = network[1],
          .note = {nullptr, figures.data_ptr<float>(), stop.data_ptr<float>(), -1, number.const_data_ptr<float>()},
          .value_loss = figures.data_ptr<float>() + kFigValueLoss};
}

std::string no_fused_kernels() {
  if (cuda_device_count() == 0) return "no GPU";
  return fused_gradients_run(0) ? "" : "this GPU has too little shared memory";
}

}  // namespace giga::test
