#include "policies.hpp"

#include <ATen/CPUGeneratorImpl.h>

#include "config/fields.hpp"
#include "scenario/scenario.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

at::Tensor random(at::IntArrayRef shape, uint64_t seed) {
  at::Generator generator = at::detail::createCPUGenerator(seed);
  return at::randn(shape, generator, at::TensorOptions().dtype(at::kFloat));
}

}  // namespace

SimSpec small_spec(ActionKind actions) {
  SimSpec spec = plain_spec(2, 2);
  spec.name = "small";
  spec.params.actions = actions;
  spec.params.waypoints = true;
  spec.maps[0].boxes = {{1, 1, 2, 2, 0, 10}, {7, 7, 8, 9, 0, 10}};
  spec.finish();
  return spec;
}

std::string ActorKind::name() const {
  return FieldCodec<ActionKind>::print(actions) + "_" + FieldCodec<Activation>::print(activation) +
         (layer_norm ? "_layer_norm" : "") + (normalizes ? "_normalizes" : "") + (reads_part ? "_reads_part" : "") +
         (memory == MemoryKind::none ? "" : "_" + FieldCodec<MemoryKind>::print(memory));
}

std::vector<ActorKind> all_kinds() {
  std::vector<ActorKind> kinds;
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous})
    for (const Activation activation : {Activation::tanh, Activation::relu, Activation::silu, Activation::gelu})
      for (const bool layer_norm : {false, true})
        for (const bool normalizes : {false, true}) kinds.push_back({actions, activation, layer_norm, normalizes});
  kinds.push_back({ActionKind::discrete, Activation::tanh, false, false, true});
  kinds.push_back({ActionKind::continuous, Activation::relu, false, true, true});
  for (const MemoryKind memory : {MemoryKind::gru, MemoryKind::lstm}) {
    kinds.push_back({ActionKind::discrete, Activation::tanh, false, false, true, memory});
    kinds.push_back({ActionKind::continuous, Activation::relu, true, true, false, memory});
  }
  return kinds;
}

Actor make_random_actor(const ActorKind& kind) {
  ActorConfig config;
  config.hidden = {12, 10};
  config.activation = kind.activation;
  config.layer_norm = kind.layer_norm;
  config.output_gain = 1;
  config.memory = kind.memory;
  config.memory_size = 9;
  const InputColumns inputs = kind.reads_part ? InputColumns(kPaddedInputs, 8, 40) : InputColumns(kPaddedInputs);
  Actor actor(config, inputs, kind.actions, kind.normalizes, Precision::fp32, at::kCPU, 1);
  actor.parameters().values().add_(random({actor.parameters().size()}, 2), 0.1);
  if (kind.normalizes) actor.normalizer().update(random_observations(64), at::ones({64}));
  return actor;
}

at::Tensor random_observations(int64_t rows) {
  at::Tensor obs = random({rows, kPaddedInputs}, 3) * 3 + 2;
  obs.slice(1, kInputs, kPaddedInputs).zero_();
  return obs;
}

at::Tensor third_head(const Policy& policy, const at::Tensor& obs) {
  at::NoGradGuard no_grad;
  NetworkState state;
  for (int step = 0; step < 2; ++step) policy.forward(obs, state);
  return policy.forward(obs, state);
}

PolicyOrigin sample_origin() {
  return {"0.1.0",     "small", "description: \"two lines:\\n\\\"caf\xC3\xA9\\\"\"\nrules: corrected\n",
          "seed: 7\n", 1,       7,
          12,          4096,    Precision::tf32};
}

}  // namespace giga::test
