#include "rollout/collector.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "policy/parameters.hpp"
#include "rollout/shapes.hpp"
#include "rollout/tensors.hpp"

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

at::Tensor zeros(const BufferShape& shape, Device device) {
  constexpr at::ScalarType kTypes[] = {at::kFloat, at::kInt, at::kByte, at::kBFloat16};  // by ElementType
  const auto options = at::TensorOptions().dtype(kTypes[static_cast<size_t>(shape.type)]).device(torch_device(device));
  return at::zeros(shape.sides, options);
}

BufferSet buffers_of(const Side& side) {
  const auto any = [&side](auto&& holds) {
    return std::any_of(side.begin(), side.end(), [&](const SidePart& part) { return holds(*part.controller); });
  };
  if (any([](const TeamController& c) { return c.fills_log_prob(); })) return BufferSet::learning;
  return any([](const TeamController& c) { return !c.reads().empty(); }) ? BufferSet::observations : BufferSet::actions;
}

Rollout make_rollout(const Simulator& sim, const CollectorOptions& options, const BothSides& sides) {
  const RolloutShapes shapes = rollout_shapes(
      sim.spec(), {sim.n_worlds(), options.horizon, options.with_state, {buffers_of(sides[0]), buffers_of(sides[1])}});
  const auto make = [&](const BufferShape& shape) {
    return shape.exists() ? zeros(shape, sim.device()) : at::Tensor();
  };
  Rollout rollout;
  for (int team = 0; team < kNTeams; ++team) {
    const TeamRolloutShapes& s = shapes.team[team];
    rollout.team[team] = {make(s.obs),      make(s.alive),  make(s.action),    make(s.raw),
                          make(s.log_prob), make(s.reward), make(s.final_obs), make(s.final_alive)};
  }
  rollout.done = make(shapes.done);
  rollout.true_state = make(shapes.true_state);
  rollout.final_true_state = make(shapes.final_true_state);
  return rollout;
}

}  // namespace

Collector::Collector(Simulator& sim, const ParallelFor& rows, const CollectorOptions& options, const BothSides& sides)
    : options_(options), rollout_(make_rollout(sim, options, sides)), game_(sim, rows, sides, {this}) {
  for (int team = 0; team < kNTeams; ++team) {
    TeamRollout& r = rollout_.team[team];
    const int64_t size = memory_size(sides[static_cast<size_t>(team)]);
    if (size == 0) continue;
    r.state = at::zeros({sim.n_worlds(), sim.params().n_team[team], size}, r.obs.options());
    memory_[team] = r.state.clone();
  }
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
    r.obs[0].copy_(r.obs[n_steps]);
    r.alive[0].copy_(r.alive[n_steps]);
  }
  if (rollout_.true_state.defined()) rollout_.true_state[0].copy_(rollout_.true_state[n_steps]);
  for (int team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) rollout_.team[team].state.copy_(memory_[team]);
}

// It is the first observer of its game, so it replaces nobody's buffers.
// Step t looks at slot t, fills it, and writes what comes of it to slot t + 1. What starts a game writes to slot T.
void Collector::before_step(int64_t t, GameStep& step) {
  if (t < 0) t = options_.horizon - 1;
  // One slot per world is enough: a world is truncated at most once in a rollout that is no longer than an episode.
  step.io.final_of_truncations_only = true;
  for (int team = 0; team < kNTeams; ++team) {
    const TeamRollout& r = rollout_.team[team];
    TeamIo& out = step.io.team[team];
    step.rows[team] = {slot<float>(r.obs, t + 1), whole<float>(r.final_obs),
                       r.alive.defined() ? options_.keep : ObservationSet()};
    out.alive = slot<uint8_t>(r.alive, t + 1);
    out.reward = slot<float>(r.reward, t);
    out.final_alive = whole<uint8_t>(r.final_alive);
    void* action = static_cast<char*>(r.action.data_ptr()) + t * r.action.stride(0) * r.action.itemsize();
    step.team[team] = {slot<float>(r.obs, t), action, slot<float>(r.raw, t), slot<float>(r.log_prob, t),
                       whole<float>(memory_[team])};
  }
  step.io.world[Observation::state] = {slot<float>(rollout_.true_state, t + 1),
                                       whole<float>(rollout_.final_true_state)};
  step.io.done = slot<uint8_t>(rollout_.done, t);
}

}  // namespace giga
