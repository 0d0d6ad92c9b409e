#include "policy/critic.hpp"

#include <ATen/ATen.h>

#include "sim/state_encoding.hpp"

namespace giga {

CriticShape critic_shape(const CriticConfig& config, const SimSpec& spec, int team) {
  const SimParams& p = spec.params;
  return {team, {p.n_team[0], p.n_team[1]}, input_columns(config.inputs, spec), world_feature_count(p)};
}

std::pair<MlpConfig, MlpConfig> split_state_critic(const CriticConfig& config) {
  MlpConfig first = config, rest = config;
  first.hidden = {config.hidden.front()};
  rest.hidden.erase(rest.hidden.begin());
  if (rest.hidden.empty()) rest.hidden = first.hidden;
  return {first, rest};
}

Critic::Critic(const CriticConfig& config, const CriticShape& shape, Precision precision, const ParallelFor& rows,
               at::Device device, uint64_t seed)
    : kind_(config.kind), shape_(shape), precision_(precision), rows_(&rows) {
  add_parameters(config, shape);
  parameters_.allocate(device, seed);
}

int64_t Critic::count_parameters(const CriticConfig& config, const CriticShape& shape) {
  Critic critic;
  critic.add_parameters(config, shape);
  return critic.parameters_.size();
}

void Critic::add_parameters(const CriticConfig& config, const CriticShape& shape) {
  switch (config.kind) {
    case CriticKind::composed:
      team_mlp_ = TeamMlp(parameters_, "team_mlp", shape.inputs.size, config, 1, config.output_gain);
      break;
    case CriticKind::independent:
      mlp_ = Mlp(parameters_, "mlp", shape.inputs.size, config, 1, config.output_gain);
      break;
    case CriticKind::state: {
      const auto [first, rest] = split_state_critic(config);
      entity_ = Mlp(parameters_, "entity", kEntityFeatures, first, 0, 0);
      mlp_ = Mlp(parameters_, "mlp", 3 * first.hidden[0] + shape.world_features, rest, 1, config.output_gain);
      break;
    }
  }
}

at::Tensor Critic::forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state) const {
  if (kind_ == CriticKind::state) return forward_state(state);
  at::Tensor x = columns_of(shape_.inputs, obs);
  if (precision_ == Precision::bf16) x = x.to(at::kBFloat16);
  const at::Tensor value =
      kind_ == CriticKind::composed ? team_mlp_.forward(parameters_, *rows_, x, alive) : mlp_.forward(parameters_, x);
  return value.squeeze(-1).to(at::kFloat);
}

// Deep Sets (Zaheer et al. 2017): one encoder for all agents; each own agent is valued from its encoding, the means
// over the living of both teams, and the world. The order of the agents inside a team does not matter.
at::Tensor Critic::forward_state(const at::Tensor& state) const {
  const int n_agents = shape_.n_team[0] + shape_.n_team[1], own = shape_.n_team[shape_.team];
  const int own_first = shape_.team == 0 ? 0 : shape_.n_team[0], other_first = shape_.team == 0 ? shape_.n_team[0] : 0;
  const int64_t b = state.size(0), entity_columns = n_agents * kEntityFeatures;
  at::Tensor entities = state.slice(1, 0, entity_columns).reshape({b, n_agents, kEntityFeatures});
  at::Tensor alive = entities.slice(2, 0, 1);
  at::Tensor world = state.slice(1, entity_columns);
  if (precision_ == Precision::bf16) {
    entities = entities.to(at::kBFloat16);
    world = world.to(at::kBFloat16);
  }
  const at::Tensor code = entity_.forward(parameters_, entities);
  const auto team_mean = [&](int first, int n) {
    const at::Tensor living = alive.slice(1, first, first + n).squeeze(-1).contiguous();
    return living_mean(*rows_, code.slice(1, first, first + n).contiguous(), living).unsqueeze(1);
  };
  const at::Tensor own_mean = team_mean(own_first, own);
  const at::Tensor other_mean = team_mean(other_first, n_agents - own);
  const at::Tensor context = at::cat({own_mean, other_mean, world.unsqueeze(1)}, -1).expand({b, own, -1});
  const at::Tensor input = at::cat({code.slice(1, own_first, own_first + own), context}, -1);
  return mlp_.forward(parameters_, input).squeeze(-1).to(at::kFloat);
}

}  // namespace giga
