#include "rollout/collector.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "policy/parameters.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_state.hpp"
#include "sim/row_layout.hpp"

namespace giga {
namespace {

/// Slot t; of what has one slot only, that one.
template <class T>
T* slot(const at::Tensor& tensor, int64_t t) {
  if (!tensor.defined()) return nullptr;
  return tensor.data_ptr<T>() + (tensor.size(0) > 1 ? t * tensor.stride(0) : 0);
}
template <class T>
T* whole(const at::Tensor& tensor) {
  return tensor.defined() ? tensor.data_ptr<T>() : nullptr;
}

Rollout make_rollout(Simulator& sim, const CollectorOptions& options, const BothSides& sides) {
  const SimSpec& spec = sim.spec();
  const int64_t t = options.horizon, w = sim.n_worlds(), d = observation_rows(spec).stride(), g = spec.state_size();
  const auto make = [&sim](at::IntArrayRef sizes, at::ScalarType type = at::kFloat) {
    return at::zeros(sizes, at::TensorOptions().dtype(type).device(torch_device(sim.device())));
  };
  Rollout rollout;
  for (size_t team = 0; team < kNTeams; ++team) {
    TeamRollout& r = rollout.team[team];
    const int64_t n = spec.params.n_team[team];
    const bool discrete = spec.params.actions == ActionKind::discrete;
    r.action = discrete ? make({t, w, n}, at::kInt) : make({t, w, n, kActionSize});
    ObservationSet reads;
    bool learns = false;
    for (const SidePart& part : sides[team]) {
      reads |= part.controller->reads();
      learns = learns || (options.learns[team] && part.controller->fills_log_prob());
    }
    if (learns) reads |= options.keep;
    if (!(reads & spec.observations()).empty()) r.obs = make({learns ? t + 1 : 1, w, n, d});
    if (!learns) continue;
    if (reads.has(Observation::image)) rollout.images.sim = &sim;
    r.alive = make({t + 1, w, n}, at::kByte);
    if (!discrete) r.pre_tanh_action = make({t, w, n, kActionSize});
    r.log_prob = make({t, w, n});
    r.reward = make({t, w, n});
    if (r.obs.defined()) r.final_obs = make({w, n, d});
    r.final_alive = make({w, n}, at::kByte);
  }
  rollout.done = make({t, w}, at::kByte);
  if (options.with_state) {
    rollout.true_state = make({t + 1, w, g});
    rollout.final_true_state = make({w, g});
  }
  if (rollout.images.sim) {
    const int64_t s = image_state_size(spec.params);
    rollout.images.states = make({t + 1, w, s}, at::kInt);
    if (options.with_final_images) rollout.images.final_states = make({w, s}, at::kInt);
  }
  return rollout;
}

}  // namespace

at::Tensor Rollout::beginnings() const {
  const at::Tensor ended = done != 0;  // the next step begins an episode
  return at::cat({at::zeros_like(ended.slice(0, 0, 1)), ended});
}

Collector::Collector(Simulator& sim, const ParallelFor& parallel_for, const CollectorOptions& options,
                     const BothSides& sides)
    : options_(options), rollout_(make_rollout(sim, options, sides)), game_(sim, parallel_for, sides, {this}) {
  if (options.mirror) game_.mirror_half();
  for (int team = 0; team < kNTeams; ++team) {
    TeamRollout& r = rollout_.team[team];
    const int64_t size = memory_size(sides[static_cast<size_t>(team)]);
    if (size == 0) continue;
    r.state = at::zeros({sim.n_worlds(), sim.params().n_team[team], size},
                        at::TensorOptions().dtype(at::kFloat).device(torch_device(sim.device())));
    memory_[team] = r.state.clone();
  }
}

void Collector::forget(int team, const ShardRange& worlds) {
  if (memory_[team].defined()) in_shards(memory_[team], worlds, 0).zero_();
}

void Collector::save(const std::string& prefix, NamedArrays& out) const {
  for (int team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) out.push_back(to_array(cat(prefix, "memory_", team), memory_[team]));
}

void Collector::load(const std::string& prefix, const NamedArrays& in) {
  for (int team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) from_array(find_array(in, cat(prefix, "memory_", team)), memory_[team]);
}

void Collector::start() {
  game_.start();
  if (options_.desynchronize) game_.desynchronize();
}

void Collector::before_play(int64_t n_steps) {
  GIGA_CHECK(n_steps == options_.horizon, n_steps, " steps for ", options_.horizon, " slots");
  for (const TeamRollout& r : rollout_.team) {
    if (!r.alive.defined()) continue;
    if (r.obs.defined()) r.obs[0].copy_(r.obs[n_steps]);
    r.alive[0].copy_(r.alive[n_steps]);
  }
  for (const at::Tensor& states : {rollout_.true_state, rollout_.images.states})
    if (states.defined()) states[0].copy_(states[n_steps]);
  for (int team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) rollout_.team[team].state.copy_(memory_[team]);
}

// It is the first observer of its game, so it replaces nobody's buffers.
// Step t looks at slot t, fills it, and writes what comes of it to slot t + 1. What starts a game writes to slot T.
void Collector::before_step(int64_t t, GameStep& step) {
  steps_done_ = std::max<int64_t>(t, 0);
  if (t < 0) t = options_.horizon - 1;
  // One slot per world is enough: a world is truncated at most once in a rollout that is no longer than an episode.
  step.io.final_of_truncations_only = true;
  for (int team = 0; team < kNTeams; ++team) {
    const TeamRollout& r = rollout_.team[team];
    TeamIo& out = step.io.team[team];
    step.rows[team] = {slot<float>(r.obs, t + 1), whole<float>(r.final_obs),
                       r.alive.defined() ? options_.keep & all_numbers() : ObservationSet()};
    out.alive = slot<uint8_t>(r.alive, t + 1);
    out.reward = slot<float>(r.reward, t);
    out.final_alive = whole<uint8_t>(r.final_alive);
    void* action = static_cast<char*>(r.action.data_ptr()) + t * r.action.stride(0) * r.action.itemsize();
    TeamBuffers& buffers = step.team[team];  // the images are those of the game
    buffers.obs = slot<float>(r.obs, t);
    buffers.action = action;
    buffers.pre_tanh_action = slot<float>(r.pre_tanh_action, t);
    buffers.log_prob = slot<float>(r.log_prob, t);
    buffers.memory = whole<float>(memory_[team]);
  }
  step.io.world[Observation::state] = {slot<float>(rollout_.true_state, t + 1),
                                       whole<float>(rollout_.final_true_state)};
  step.io.world[Observation::image_state] = {slot<int32_t>(rollout_.images.states, t + 1),
                                             whole<int32_t>(rollout_.images.final_states)};
  step.io.done = slot<uint8_t>(rollout_.done, t);
}

}  // namespace giga
