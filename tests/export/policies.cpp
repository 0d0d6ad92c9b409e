#include "policies.hpp"

#include <ATen/CPUGeneratorImpl.h>

#include <algorithm>

#include "config/fields.hpp"
#include "core/philox.hpp"
#include "scenario/scenario.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"
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

SimSpec small_spec_with_view(ActionKind actions) {
  SimSpec spec = small_spec(actions);
  spec.params.egocentric_view = true;
  spec.finish();
  return spec;
}

Actor make_actor_with_view(const ActorKind& kind) {
  const SimSpec spec = small_spec_with_view(kind.actions);
  ActorConfig config;
  config.hidden = {12, 10};
  config.output_gain = 1;
  config.inputs = kind.reads_part ? NetworkInputs::egocentric : NetworkInputs::all;
  config.memory = kind.memory;
  config.memory_size = 9;
  Actor actor(config, input_columns(config.inputs, spec), kind.actions, kind.normalizes, Precision::fp32, at::kCPU, 1);
  const at::Tensor rows = padded(played_rows(spec, 64), spec);
  if (kind.normalizes) actor.normalizer().update(rows, at::ones({64}));
  return actor;
}

at::Tensor padded(const at::Tensor& rows, const SimSpec& spec) {
  return at::constant_pad_nd(rows, {0, observation_rows(spec).stride() - rows.size(1)});
}

std::string ActorKind::name() const {
  return FieldCodec<ActionKind>::print(actions) + "_" + FieldCodec<Activation>::print(activation) +
         (layer_norm ? "_layer_norm" : "") + (normalizes ? "_normalizes" : "") + (reads_part ? "_reads_part" : "") +
         (memory == MemoryKind::none ? "" : "_" + FieldCodec<MemoryKind>::print(memory)) +
         (encoder == EncoderKind::mlp ? "" : "_" + FieldCodec<EncoderKind>::print(encoder));
}

std::vector<ActorKind> image_kinds() {
  return {{.activation = Activation::relu, .encoder = EncoderKind::nature},
          {.actions = ActionKind::continuous,
           .activation = Activation::tanh,
           .layer_norm = true,
           .memory = MemoryKind::gru,
           .encoder = EncoderKind::impala},
          {.activation = Activation::relu, .encoder = EncoderKind::compact}};
}

SimSpec small_spec_with_images(const ActorKind& kind) {
  SimSpec spec = small_spec(kind.actions);
  spec.params.resolution = kind.image_side();
  spec.params.images_only = true;
  return spec;
}

at::Tensor varied_images(int64_t rows, int side) {
  const at::Tensor k = at::arange(rows * side * side * 3);
  const at::Tensor images = ((k * 37 + k.div(101, "floor") * 11) % 256).to(at::kByte).view({rows, side, side, 3});
  // In all but the first an agent: its own colour (rules 8.3), in one corner or another.
  for (int64_t row = 1; row < rows; ++row)
    images[row][row * 2 % side][side - 1 - row * 5 % side] = at::tensor({100, 255, 100}, at::kByte);
  return images.view({rows, -1});
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
  config.encoder = kind.encoder;
  config.impala_width = 4;
  InputColumns inputs = kind.reads_part ? InputColumns(kPaddedInputs, 8, 40) : InputColumns(kPaddedInputs);
  if (config.reads_image()) inputs = InputColumns::image_of(kind.image_side());
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

at::Tensor played_rows(SimSpec spec, int64_t n_rows) {
  spec.params.actions = ActionKind::discrete;
  SimOptions options;
  options.n_worlds = static_cast<int>(std::clamp<int64_t>(n_rows / spec.params.n_agents / 40, 1, 32));
  options.seed = 3;
  const bool crowd = spec.params.n_agents > kMaxAgents;
  const auto sim = crowd ? make_grid_simulator(spec, options) : make_cpu_simulator(spec, options);
  const RowLayout layout = observation_rows(spec);
  at::Tensor action[kNTeams], rows[kNTeams];
  StepIo io;
  for (int t = 0; t < kNTeams; ++t) {
    const int64_t agents = int64_t{options.n_worlds} * spec.params.n_team[t];
    action[t] = at::zeros({agents}, at::kInt);
    rows[t] = at::zeros({agents, layout.stride()});
    io.team[t].action = action[t].data_ptr();
    layout.attach(io.team[t], layout.set(), rows[t].data_ptr<float>());
  }
  sim->start(io);
  std::vector<at::Tensor> kept;
  int64_t n_kept = 0;
  for (int step = 0; n_kept < n_rows; ++step) {
    for (uint32_t t = 0; t < kNTeams; ++t) {
      DrawKey key(2, t, static_cast<uint32_t>(step / 4));  // each held for a while, so that agents get somewhere
      for (int64_t k = 0; k < action[t].numel(); ++k)
        action[t].data_ptr<int32_t>()[k] =
            static_cast<int32_t>(key.uniform(Draw::action, static_cast<uint32_t>(k), 0) * kNDiscreteActions);
    }
    sim->step(io);
    if (step % 8 != 0) continue;
    for (const at::Tensor& team : rows) kept.push_back(team.slice(1, 0, layout.numbers()).clone());
    n_kept += int64_t{options.n_worlds} * spec.params.n_agents;
  }
  return at::cat(kept).slice(0, 0, n_rows);
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
