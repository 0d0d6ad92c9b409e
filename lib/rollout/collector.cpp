#include "rollout/collector.hpp"

#include <algorithm>
#include <vector>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "policy/parameters.hpp"
#include "policy/policy.hpp"
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
  for (size_t team = 0; team < kNTeams; ++team) {
    TeamRollout& r = rollout_.team[team];
    for (const SidePart& part : side_[team])
      if (part.player.policy && part.player.policy->state_size() > 0)
        r.state =
            at::zeros({sim.n_worlds(), sim.params().n_team[team], part.player.policy->state_size()}, r.obs.options());
    memory_[team] = r.state.defined() ? r.state.clone() : at::Tensor();
  }
}

void Collector::save(const std::string& prefix, NamedArrays& out) const {
  for (size_t team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) out.push_back(to_array(cat(prefix, "memory_", team), memory_[team]));
}

void Collector::load(const std::string& prefix, const NamedArrays& in) {
  for (size_t team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) from_array(find_array(in, cat(prefix, "memory_", team)), memory_[team]);
}

/// A part's policy moves its worlds and remembers them.
void Collector::act_with_memory(const SidePart& part, int team, ActIo io) {
  const at::Tensor own = memory_[static_cast<size_t>(team)].narrow(0, part.worlds.first, part.worlds.count);
  NetworkState state{own.flatten(0, 1)};
  io.state = &state;
  act(part.player, sim_, rows_, team, io, part.worlds);
  own.copy_(state.rows.view(own.sizes()));
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
  for (size_t team = 0; team < kNTeams; ++team)
    if (memory_[team].defined()) rollout_.team[team].state.copy_(memory_[team]);
  for (int t = 0; t < horizon; ++t) {
    for (int team = 0; team < kNTeams; ++team) {
      const TeamRollout& r = rollout_.team[team];
      void* action = static_cast<char*>(r.action.data_ptr()) + t * r.action.stride(0) * r.action.itemsize();
      const ActIo io{slot<float>(r.obs, t), action, slot<float>(r.raw, t), slot<float>(r.log_prob, t)};
      for (const SidePart& part : side_[static_cast<size_t>(team)]) {
        if (r.state.defined() && part.player.policy)
          act_with_memory(part, team, io);
        else
          act(part.player, sim_, rows_, team, io, part.worlds);
      }
    }
    sim_.step(io(t));
    for (const at::Tensor& memory : memory_)
      if (memory.defined()) memory.masked_fill_((rollout_.done[t] != 0).view({-1, 1, 1}), 0);  // an episode has ended
  }
}

}  // namespace giga
