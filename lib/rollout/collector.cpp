#include "rollout/collector.hpp"

#include <algorithm>
#include <vector>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "rollout/shapes.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Slot t; of what has one slot only, that one.
template <class T>
T* slot(const at::Tensor& tensor, int t) {
  if (!tensor.defined()) return nullptr;
  return tensor.data_ptr<T>() + (tensor.size(0) > 1 ? t * tensor.stride(0) : 0);
}
template <class T>
T* whole(const at::Tensor& tensor) {
  return tensor.defined() ? tensor.data_ptr<T>() : nullptr;
}

at::Tensor zeros(const BufferShape& shape, Device device) {
  constexpr at::ScalarType kTypes[] = {at::kFloat, at::kInt, at::kByte};  // by ElementType
  const auto options = at::TensorOptions().dtype(kTypes[static_cast<size_t>(shape.type)]).device(torch_device(device));
  return at::zeros(shape.sides, options);
}

BufferSet buffers_of(const Side& side) {
  const auto any = [&side](auto&& holds) {
    return std::any_of(side.begin(), side.end(), [&](const SidePart& part) { return holds(part.player); });
  };
  if (any([](const Player& player) { return player.policy != nullptr; })) return BufferSet::learning;
  return any([](const Player& player) { return player.looks(); }) ? BufferSet::observations : BufferSet::actions;
}

void check_complete(const Side& side, int64_t n_worlds) {
  int64_t next = 0;
  for (const SidePart& part : side) {
    GIGA_CHECK(part.worlds.first == next && part.worlds.count > 0, "worlds ", part.worlds.first, " to ",
               part.worlds.end(), " after ", next);
    next = part.worlds.end();
  }
  GIGA_CHECK(next == n_worlds, "somebody moves in ", next, " of ", n_worlds, " worlds");
}

}  // namespace

Collector::Collector(Simulator& sim, const RowRunner& rows, const CollectorOptions& options,
                     std::array<Side, kNTeams> sides)
    : sim_(sim), rows_(rows), options_(options), side_(std::move(sides)) {
  for (const Side& side : side_) check_complete(side, sim.n_worlds());
  const RolloutShapes shapes = rollout_shapes(
      sim.spec(), {sim.n_worlds(), options.horizon, options.with_state, {buffers_of(side_[0]), buffers_of(side_[1])}});
  const auto make = [&](const BufferShape& shape) {
    return shape.exists() ? zeros(shape, sim.device()) : at::Tensor();
  };
  for (int team = 0; team < kNTeams; ++team) {
    TeamRollout& r = rollout_.team[team];
    const TeamRolloutShapes& s = shapes.team[team];
    r = {make(s.obs),      make(s.alive),  make(s.action),    make(s.raw),
         make(s.log_prob), make(s.reward), make(s.final_obs), make(s.final_alive)};
  }
  rollout_.done = make(shapes.done);
  rollout_.global = make(shapes.global);
  rollout_.final_global = make(shapes.final_global);
}

StepIo Collector::io(int t) const {
  StepIo io;
  io.obs_stride = sim_.spec().padded_observation_size();
  // One slot per world is enough: a world is truncated at most once in a rollout that is no longer than an episode.
  io.final_of_truncations_only = true;
  for (int team = 0; team < kNTeams; ++team) {
    const TeamRollout& r = rollout_.team[team];
    TeamIo& out = io.team[team];
    out.obs = slot<float>(r.obs, t + 1);
    out.alive = slot<uint8_t>(r.alive, t + 1);
    out.action = static_cast<char*>(r.action.data_ptr()) + t * r.action.stride(0) * r.action.itemsize();
    out.reward = slot<float>(r.reward, t);
    out.final_obs = whole<float>(r.final_obs);
    out.final_alive = whole<uint8_t>(r.final_alive);
  }
  io.global = slot<float>(rollout_.global, t + 1);
  io.final_global = whole<float>(rollout_.final_global);
  io.done = slot<uint8_t>(rollout_.done, t);
  return io;
}

void Collector::start() {
  sim_.start(io(options_.horizon - 1));
  const int limit = sim_.params().max_episode_length;
  if (!options_.desynchronize || limit <= 1) return;
  std::vector<int32_t> ages(static_cast<size_t>(sim_.n_worlds()));
  for (size_t w = 0; w < ages.size(); ++w) {
    const auto world = static_cast<uint32_t>(sim_.options().first_world) + static_cast<uint32_t>(w);
    DrawKey key(sim_.options().seed, world, 0);
    ages[w] = static_cast<int32_t>(key.uniform(Draw::init, 0, 0) * static_cast<float>(limit));
    if (ages[w] >= limit) ages[w] = limit - 1;
  }
  sim_.synchronize();
  sim_.memory().from_host(sim_.state().view().episode_length, ages.data(), ages.size() * sizeof(int32_t));
}

void Collector::resume() { sim_.observe(io(options_.horizon - 1)); }

void Collector::collect() {
  const int horizon = options_.horizon;
  for (const TeamRollout& r : rollout_.team) {
    if (!r.alive.defined()) continue;
    r.obs[0].copy_(r.obs[horizon]);
    r.alive[0].copy_(r.alive[horizon]);
  }
  if (rollout_.global.defined()) rollout_.global[0].copy_(rollout_.global[horizon]);
  for (int t = 0; t < horizon; ++t) {
    for (int team = 0; team < kNTeams; ++team) {
      const TeamRollout& r = rollout_.team[team];
      void* action = static_cast<char*>(r.action.data_ptr()) + t * r.action.stride(0) * r.action.itemsize();
      const ActIo io{slot<float>(r.obs, t), action, slot<float>(r.raw, t), slot<float>(r.log_prob, t)};
      for (const SidePart& part : side_[static_cast<size_t>(team)])
        act(part.player, sim_, rows_, team, io, part.worlds);
    }
    sim_.step(io(t));
  }
}

}  // namespace giga
