#include "policy/actor.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include "math/dense_rows.hpp"

namespace giga {

constexpr double kObsNormBeta = 0.99;  // share kept per rollout

Actor::Actor(const ActorConfig& config, const InputColumns& inputs, ActionKind actions, bool normalize,
             Precision precision, at::Device device, uint64_t seed)
    : config_(config),
      log_std_min_(config.log_std_min),
      log_std_max_(config.log_std_max),
      actions_(actions),
      inputs_(inputs),
      normalize_(normalize),
      precision_(precision) {
  GIGA_CHECK(!config.remembers() || precision != Precision::fp16, "a memory in half precision");
  GIGA_CHECK(!normalize || !inputs.is_image(), "a normaliser of images");
  const char* name = enum_names(config.encoder)[static_cast<size_t>(config.encoder)];
  network_ = Network(parameters_, name, config, {inputs.shape(), head_size(), config.output_gain});
  if (actions_ == ActionKind::continuous)
    log_std_ = parameters_.add("log_std", {kActionSize}, {Init::Kind::constant, config.log_std_init});
  parameters_.allocate(device, seed);
  if (normalize) normalizer_ = RunningNorm(inputs.row, kObsNormBeta, device);
}

at::Tensor Actor::input_of(const at::Tensor& obs) const {
  at::Tensor x = columns_of(inputs_, obs);
  if (normalize_)
    x = RunningNorm::normalized(x, columns_of(inputs_, normalizer_.mean()), columns_of(inputs_, normalizer_.std()));
  // Of an image the encoder makes numbers: its first layer reads bytes faster.
  return precision_ == Precision::bf16 && !inputs_.is_image() ? x.to(at::kBFloat16) : x;
}

at::Tensor Actor::forward(const at::Tensor& obs, NetworkState& state) const {
  if (state_size() == 0) return forward_sequence(obs, {});
  at::Tensor states;
  const at::Tensor head = forward_sequence(obs, {.start = state.rows, .states = &states});
  state.rows = states[0];
  return head;
}

at::Tensor Actor::forward_sequence(const at::Tensor& obs, const Sequence& sequence, at::Tensor* kept) const {
  const ReadParameters p = read_parameters();
  const at::Tensor x = features(*p, obs);
  if (kept) *kept = x;
  return head(*p, x, sequence);
}

at::Tensor Actor::features(const at::Tensor& obs) const { return features(*read_parameters(), obs); }

at::Tensor Actor::head(const at::Tensor& features, const Sequence& sequence) const {
  return head(*read_parameters(), features, sequence);
}

at::Tensor Actor::features(const ParameterSet& p, const at::Tensor& obs) const {
  return network_.encoder().forward(p, input_of(obs), rounding());
}

at::Tensor Actor::head(const ParameterSet& p, const at::Tensor& features, const Sequence& sequence) const {
  return network_.behind_encoder(p, features, sequence, rounding()).to(at::kFloat);
}

at::Tensor Actor::forward_members(const at::Tensor& members, const at::Tensor& obs, NetworkState& state) const {
  at::NoGradGuard no_grad;
  return network_.forward_members(parameters_, members, input_of(obs), state, rounding()).to(at::kFloat);
}

std::optional<at::Tensor> Actor::small_head(const at::Tensor& obs, const ParallelFor& parallel_for) const {
  const std::optional<SmallMlp> mlp = inputs_.is_image() ? std::nullopt : network_.small(parameters_);
  if (!mlp || !mlp->fits_population()) return std::nullopt;
  const float* const numbers = parameters_.values().const_data_ptr<float>();
  at::Tensor x = obs.contiguous();
  for (int l = 0; l < mlp->n_layers; ++l) {
    const bool first = l == 0, last = l + 1 == mlp->n_layers, normalizes = first && normalize_;
    const at::Tensor y = at::empty({x.size(0), mlp->width[l + 1]}, x.options());
    const auto column = [&](const at::Tensor& of_row) { return of_row.const_data_ptr<float>() + inputs_.first; };
    const DenseRows layer{.x = x.const_data_ptr<float>() + (first ? inputs_.first : 0),
                          .stride = x.size(1),
                          .mean = normalizes ? column(normalizer_.mean()) : nullptr,
                          .std = normalizes ? column(normalizer_.std()) : nullptr,
                          .limit = kNormalizedLimit,
                          .weight = numbers + mlp->weight[l],
                          .bias = numbers + mlp->bias[l],
                          .inputs = mlp->width[l],
                          .outputs = mlp->width[l + 1],
                          .activated = !last,
                          .activation = mlp->activation,
                          .y = y.data_ptr<float>()};
    parallel_for.run(layer, y.numel());
    x = y;
  }
  return x;
}

at::Tensor Actor::log_std() const {
  return precision_ == Precision::fp16 ? rounded_to_half(parameters_[log_std_]) : parameters_[log_std_];
}

void Actor::bound_log_std(const at::Tensor& parameters) const {
  if (actions_ == ActionKind::discrete) return;
  at::NoGradGuard no_grad;
  parameters.narrow(0, log_std_offset(), kActionSize).clamp_(log_std_min_, log_std_max_);
}

std::optional<SmallMlp> Actor::small_mlp() const {
  if (normalize_ || precision_ != Precision::fp16) return std::nullopt;
  std::optional<SmallMlp> mlp = network_.small(parameters_);
  if (mlp && !mlp->fits_population()) return std::nullopt;
  if (mlp && actions_ == ActionKind::continuous) mlp->log_std = static_cast<int>(log_std_offset());
  return mlp;
}

std::optional<FusedMlp> Actor::fused_mlp() const {
  const std::optional<SmallMlp> small = network_.small(parameters_);
  if (!small) return std::nullopt;
  FusedMlp mlp(*small, parameters_.size());
  if (actions_ == ActionKind::continuous) mlp.log_std = static_cast<int>(log_std_offset());
  return mlp.fits() ? std::optional(mlp) : std::nullopt;
}

void Actor::save(const std::string& prefix, NamedArrays& out) const {
  parameters_.save(prefix, out);
  if (normalize_) normalizer_.save(prefix + "normalizer/", out);
}

void Actor::load(const std::string& prefix, const NamedArrays& in) {
  parameters_.load(prefix, in);
  if (normalize_) normalizer_.load(prefix + "normalizer/", in);
}

}  // namespace giga
