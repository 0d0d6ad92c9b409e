#include "policy/critic.hpp"

#include <ATen/ATen.h>

#include <algorithm>

#include "core/error.hpp"
#include "policy/actor.hpp"
#include "policy/dense_epilogue.hpp"
#include "sim/state_observation.hpp"

namespace giga {

CriticShape critic_shape(const CriticConfig& config, const Actor& actor, const SimSpec& spec, int team) {
  const SimParams& p = spec.params;
  CriticShape shape{
      .team = team, .n_team = {p.n_team[0], p.n_team[1]}, .inputs = {}, .world_features = world_feature_count(p)};
  if (config.shared_encoder) {
    shape.inputs = actor.inputs();
    shape.features = actor.network().encoder().features();
  } else if (config.kind != CriticKind::state) {
    shape.inputs = inputs_of(config, spec);
  }
  return shape;
}

std::pair<NetworkConfig, NetworkConfig> split_state_critic(const CriticConfig& config) {
  NetworkConfig first = config, rest = config;
  first.hidden = {config.hidden.front()};
  first.memory = MemoryKind::none;
  rest.hidden.erase(rest.hidden.begin());
  if (rest.hidden.empty()) rest.hidden = first.hidden;
  return {first, rest};
}

namespace {

bool is_alone(const CriticShape& shape) { return shape.n_team[shape.team] == 1; }

/// The mean of a team of one is that agent: team weights would read the same numbers a second time.
CriticKind kind_in_team(const CriticConfig& config, const CriticShape& shape) {
  return config.kind == CriticKind::composed && is_alone(shape) ? CriticKind::independent : config.kind;
}

}  // namespace

Critic::Critic(const CriticConfig& config, const CriticShape& shape, Precision precision,
               const ParallelFor& parallel_for, at::Device device, std::optional<uint64_t> seed)
    : kind_(kind_in_team(config, shape)), shape_(shape), precision_(precision), parallel_for_(&parallel_for) {
  GIGA_CHECK(!shares_encoder() || (config.kind != CriticKind::state && !config.reads_image()),
             "layers on features, which are numbers of each agent");
  const std::string name = enum_names(config.encoder)[static_cast<size_t>(config.encoder)];
  const ObservationShape read =
      shares_encoder() ? ObservationShape(static_cast<int>(shape.features)) : shape.inputs.shape();
  const NetworkShape on_observations{read, 1, config.output_gain};
  switch (kind_) {
    case CriticKind::composed:
      network_ = Network(parameters_, "team_" + name, config, on_observations);
      add_team_weights("team_" + name);
      break;
    case CriticKind::independent:
      network_ = Network(parameters_, name, config, on_observations);
      break;
    case CriticKind::state: {
      const auto [first, rest] = split_state_critic(config);
      entity_ = encoder_factory(config.encoder)(parameters_, "entity", kEntityFeatures, first);
      const auto input = static_cast<int>(3 * entity_->features() + shape.world_features);
      network_ = Network(parameters_, name, rest, {input, 1, config.output_gain});
      break;
    }
  }
  parameters_.allocate(device, seed);
}

/// Each layer but the one that reads observations also reads the mean features of the team; behind a shared encoder
/// that is each.
void Critic::add_team_weights(const std::string& name) {
  const std::vector<DenseLayer> layers = network_.layers();
  for (size_t k = 0; k < layers.size(); ++k) {
    const bool reads_observations = k == 0 && layers.size() > 1 && !shares_encoder();
    const int64_t features = parameters_.shape(layers[k].weight)[1];
    team_weights_.push_back(
        reads_observations ? -1
                           : parameters_.add_beside(layers[k].weight, cat(name, "/", k, "/team_weight"), features));
  }
}

std::optional<FusedMlp> Critic::fused_mlp() const {
  if (shares_encoder()) return std::nullopt;
  const std::optional<SmallMlp> small = network_.small(parameters_);
  if (!small) return std::nullopt;
  FusedMlp mlp(*small, parameters_.size());
  if (kind_ == CriticKind::state) put_encoder_before(mlp);
  if (!mlp.fits()) return std::nullopt;
  for (size_t k = 0; k < team_weights_.size(); ++k)
    if (team_weights_[k] >= 0) mlp.team_weight[k] = static_cast<int>(parameters_.offset(team_weights_[k]));
  return mlp;
}

/// What lies behind the codes of the agents becomes layers 1 and 2, where it has so many.
void Critic::put_encoder_before(FusedMlp& mlp) const {
  const std::vector<DenseLayer> encoder = entity_->layers();
  if (encoder.size() != 1 || encoder[0].norm_weight >= 0 || mlp.n_layers != 2) {
    mlp.n_layers = 0;
    return;
  }
  const SmallMlp behind = mlp;
  mlp.n_layers = 1 + behind.n_layers;
  mlp.width[0] = kEntityFeatures;
  mlp.width[1] = static_cast<int>(entity_->features());
  mlp.weight[0] = static_cast<int>(parameters_.offset(encoder[0].weight));
  mlp.bias[0] = static_cast<int>(parameters_.offset(encoder[0].bias));
  for (int k = 0; k < behind.n_layers; ++k) {
    mlp.width[k + 2] = behind.width[k + 1];
    mlp.weight[k + 1] = behind.weight[k];
    mlp.bias[k + 1] = behind.bias[k];
  }
  const int own = shape_.team, other = 1 - own;
  mlp.state = {.first_own = own * shape_.n_team[0],
               .first_other = other * shape_.n_team[0],
               .n_other = shape_.n_team[other],
               .world = static_cast<int>(shape_.world_features)};
}

void Critic::load(const std::string& prefix, const NamedArrays& in) {
  const std::string former = prefix + "team_";
  if (kind_ != CriticKind::independent || !is_alone(shape_) ||
      std::none_of(in.begin(), in.end(), [&](const NamedArray& array) { return array.name.starts_with(former); }))
    return parameters_.load(prefix, in);
  NamedArrays arrays;
  for (const NamedArray& array : in) {
    if (!array.name.starts_with(former) || array.name.ends_with("/team_weight")) continue;
    NamedArray own = array;
    own.name = prefix + array.name.substr(former.size());
    const std::string layer = array.name.substr(0, array.name.rfind('/'));
    if (const NamedArray* of_team = look_for_array(in, layer + "/team_weight");
        of_team && own.name.ends_with("/weight")) {
      const at::Tensor sum = at::empty(own.shape, at::kFloat), more = at::empty(of_team->shape, at::kFloat);
      from_array(own, sum);
      from_array(*of_team, more);
      own = to_array(own.name, sum + more);
    }
    arrays.push_back(std::move(own));
  }
  parameters_.load(prefix, arrays);
}

at::Tensor Critic::input_of(const Actor& actor, const at::Tensor& obs) const {
  if (shares_encoder()) return actor.features(obs.flatten(0, 1)).view({obs.size(0), obs.size(1), -1});
  return actor.normalizes() && !reads_image() && obs.defined() ? actor.normalizer().apply(obs) : obs;
}

at::Tensor Critic::forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state,
                           const Sequence& sequence) const {
  const ReadParameters read(parameters_, precision_ == Precision::bf16);
  const ParameterSet& p = *read;
  if (kind_ == CriticKind::state) return forward_state(p, state, sequence);
  at::Tensor x = shares_encoder() ? obs : columns_of(shape_.inputs, obs);
  if (precision_ == Precision::bf16 && (shares_encoder() || !reads_image()))
    x = x.to(at::kBFloat16);  // of images the encoder makes numbers
  else if (shares_encoder())
    x = x.to(at::kFloat);  // of an actor in another precision, where games are only looked at
  const at::Tensor value = kind_ == CriticKind::composed ? forward_composed(p, x, alive, sequence)
                                                         : network_.forward(p, x, sequence, rounding());
  return value.view({x.size(0), x.size(1)}).to(at::kFloat);
}

// The value V_i(s_i) of each agent becomes part of a composed V(S) = f(V_1(s_1), ..., V_n(s_n)): the layers exchange
// the mean features of the team's living agents, so the order of the agents does not matter. An encoder that is no
// chain of dense layers exchanges at the output layer only; what is remembered of each agent is exchanged there too.
at::Tensor Critic::forward_composed(const ParameterSet& p, at::Tensor x, const at::Tensor& alive,
                                    const Sequence& sequence) const {
  const int64_t b = x.size(0), n = x.size(1);
  const std::vector<DenseLayer> layers = network_.layers();
  x = x.reshape({b * n, -1});
  if (layers.size() == 1) x = network_.encoder().forward(p, x, rounding());
  at::Tensor mean;  // [b, H] of x, where the layer before has left it
  for (size_t k = 0; k < layers.size(); ++k) {
    const DenseLayer& layer = layers[k];
    const auto remembers_before = [&](size_t l) { return l + 1 == layers.size() && state_size() > 0; };
    if (remembers_before(k)) x = network_.remember(p, x, sequence);
    at::Tensor of_team;
    if (team_weights_[k] >= 0) {
      if (!mean.defined()) mean = living_mean(*parallel_for_, x.view({b, n, -1}), alive);
      of_team = at::mm(mean, p[team_weights_[k]].to(x.scalar_type()).t());
    }
    if (has_fused_epilogue(p, layer, x, n)) {
      const bool wants_mean = k + 1 < layers.size() && team_weights_[k + 1] >= 0 && !remembers_before(k + 1);
      const LayerFeatures next =
          dense_epilogue(at::linear(x, p[layer.weight]), p[layer.bias], *layer.activation,
                         {.n = n, .of_team = of_team, .alive = wants_mean ? alive : at::Tensor()});
      x = next.features;
      mean = next.mean;
      continue;
    }
    at::Tensor sums = linear(x, p[layer.weight], p[layer.bias]).view({b, n, -1});
    if (of_team.defined()) sums = sums + of_team.unsqueeze(1);
    x = finish_dense(p, layer, sums).view({b * n, -1});
    mean = at::Tensor();
  }
  return x;
}

// Deep Sets (Zaheer et al. 2017): one encoder for all agents. The value of an agent of the own team follows from its
// code, the mean codes of the living agents of both teams, and the world. The order of agents in a team does not
// matter.
at::Tensor Critic::forward_state(const ParameterSet& p, const at::Tensor& state, const Sequence& sequence) const {
  const int n_agents = shape_.n_team[0] + shape_.n_team[1], own = shape_.n_team[shape_.team];
  const int64_t b = state.size(0), entity_columns = n_agents * kEntityFeatures;
  at::Tensor entities = state.slice(1, 0, entity_columns).reshape({b, n_agents, kEntityFeatures});
  const at::Tensor alive = entities.select(2, 0);
  at::Tensor world = state.slice(1, entity_columns);
  if (precision_ == Precision::bf16) {
    entities = entities.to(at::kBFloat16);
    world = world.to(at::kBFloat16);
  }
  const at::Tensor code = entity_->forward(p, entities, Rounding::none);
  // The gradient of parts goes back in one copy, that of slices in one of the whole for each.
  const std::vector<int64_t> sizes = {shape_.n_team[0], shape_.n_team[1]};
  const std::vector<at::Tensor> codes = code.split_with_sizes(sizes, 1), living = alive.split_with_sizes(sizes, 1);
  const auto team_mean = [&](int team) {
    const auto k = static_cast<size_t>(team);
    return living_mean(*parallel_for_, codes[k].contiguous(), living[k].contiguous()).unsqueeze(1);
  };
  const at::Tensor own_mean = team_mean(shape_.team), other_mean = team_mean(1 - shape_.team);
  const at::Tensor context = at::cat({own_mean, other_mean, world.unsqueeze(1)}, -1).expand({b, own, -1});
  const at::Tensor input = at::cat({codes[static_cast<size_t>(shape_.team)], context}, -1);
  return network_.forward(p, input, sequence).view({b, own}).to(at::kFloat);
}

}  // namespace giga
