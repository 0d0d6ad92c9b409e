#include "rollout/population_controller.hpp"

#include <algorithm>
#include <map>

#include "core/error.hpp"
#include "cuda/population_policy.hpp"
#include "rollout/tensors.hpp"
#include "scripted/population_scripts.hpp"
#include "sim/schedule.hpp"

namespace giga {
namespace {

/// One evaluation after the other, by LibTorch.
class LibTorchPopulations final : public PopulationController {
 public:
  LibTorchPopulations(const PopulationShape& shape, const Actor& network, bool greedy)
      : PopulationController(shape, network, greedy) {}

 private:
  void take() override {
    for (const Population& p : populations_) groups_.push_back(groups_of(p));
  }
  void drop() override { groups_.clear(); }
  void move_networks(std::span<const TeamStep> teams) override {
    for (size_t k = 0; k < populations_.size(); ++k) {
      const Population& p = populations_[k];
      move_members(p, step_of(p.team, teams)->part(shape_.worlds(k)));
      if (const TeamStep* other = step_of(1 - p.team, teams)) move_opponents(p, k, other->part(shape_.worlds(k)));
    }
  }

  /// Worlds of each member in which one network of the opponents plays.
  struct Group {
    int64_t network;
    at::Tensor worlds;  // int64
  };
  std::vector<Group> groups_of(const Population& p) const {
    std::map<int32_t, std::vector<int64_t>> worlds;  // by network
    for (size_t e = 0; e < p.opponent.size(); ++e)
      if (p.opponent[e] >= 0) worlds[p.opponent[e]].push_back(static_cast<int64_t>(e));
    std::vector<Group> groups;
    for (const auto& [network, list] : worlds)
      groups.push_back({network, at::tensor(list, at::kLong).to(opponent_.device())});
    return groups;
  }

  void run(const TeamStep& s, const at::Tensor& head, const at::Tensor& networks, const int32_t* network) const {
    const bool continuous = network_.actions() == ActionKind::continuous;
    s.parallel_for.run(
        PopulationActions{actions_of(s), head.const_data_ptr<float>(), static_cast<int>(network_.head_size()),
                          networks.const_data_ptr<float>(), networks.size(1),
                          continuous ? network_.log_std_offset() : 0, network, shape_.n_worlds},
        s.n_rows());
  }
  void move_members(const Population& p, const TeamStep& s) const {
    const at::Tensor obs =
        wrap(s.buffers.obs, {shape_.n_members, shape_.n_worlds * s.n(), s.obs_stride()}, s.sim.device());
    NetworkState state{memory_of(s, {shape_.n_members, shape_.n_worlds * s.n()})};
    const at::Tensor memory = state.rows;
    const at::Tensor head = network_.forward_members(p.members, obs, state);
    if (memory.defined()) memory.copy_(state.rows);
    run(s, head.contiguous(), p.members, nullptr);
  }
  /// What the agents of a team remember, [..., S]; undefined without memory.
  at::Tensor memory_of(const TeamStep& s, std::vector<int64_t> sizes) const {
    if (memory_size() == 0) return {};
    sizes.push_back(memory_size());
    return wrap(s.buffers.memory, sizes, s.sim.device());
  }
  // Scripts need no head.
  void move_opponents(const Population& p, size_t k, const TeamStep& s) const {
    const int64_t m = shape_.n_members, e = shape_.n_worlds, n = s.n(), d = s.obs_stride();
    const at::Tensor obs = wrap(s.buffers.obs, {m, e, n, d}, s.sim.device());
    const at::Tensor head = at::empty({m, e, n, network_.head_size()}, obs.options());
    const at::Tensor memory = memory_of(s, {m, e, n});
    for (const Group& group : groups_[k]) {
      const at::Tensor rows = obs.index_select(1, group.worlds).view({1, -1, d});
      NetworkState state;
      if (memory.defined()) state.rows = memory.index_select(1, group.worlds).view({1, -1, memory_size()});
      const at::Tensor out = network_.forward_members(p.opponents.narrow(0, group.network, 1), rows, state);
      if (memory.defined()) memory.index_copy_(1, group.worlds, state.rows.view({m, group.worlds.size(0), n, -1}));
      head.index_copy_(1, group.worlds, out.view({m, group.worlds.size(0), n, -1}));
    }
    run(s, head, p.opponents, opponents_of(k));
  }

  std::vector<std::vector<Group>> groups_;  // by population
};

/// All networks of a step in one launch of the fused kernel.
class FusedPopulations final : public PopulationController {
 public:
  FusedPopulations(const PopulationShape& shape, const Actor& network, bool greedy, const SmallMlp& mlp)
      : PopulationController(shape, network, greedy), layout_(mlp) {}

  bool repeats() const override { return true; }

 private:
  void take() override { packed_.resize(2 * populations_.size()); }
  void drop() override {
    packed_.clear();
    work_ = at::Tensor();
  }

  void move_networks(std::span<const TeamStep> teams) override {
    const TeamStep& any = teams[0];
    const int device = any.parallel_for.device().index;
    void* const stream = any.parallel_for.stream();
    if (!work_.defined()) pack(device, stream);
    PopulationPolicy policy = policy_of(teams);
    const bool lists = !work_.defined() || any.number % kListPeriod == 0;
    if (!work_.defined()) work_ = at::empty({population_work(policy)}, opponent_.options());
    policy.work = work_.data_ptr<int32_t>();
    if (lists) list_population_work(policy, device, stream);
    launch_population_policy(policy, device, stream);
  }

  void pack(int device, void* stream) {
    const auto packed = [&](const at::Tensor& networks) {
      at::Tensor numbers = at::empty({networks.size(0), layout_.size}, networks.options().dtype(at::kHalf));
      pack_population(layout_, networks.const_data_ptr<float>(), networks.size(0), networks.size(1),
                      static_cast<uint16_t*>(numbers.data_ptr()), device, stream);
      return numbers;
    };
    for (size_t k = 0; k < populations_.size(); ++k) {
      packed_[2 * k] = packed(populations_[k].members);
      packed_[2 * k + 1] = packed(populations_[k].opponents);
    }
  }

  PopulationPolicy policy_of(std::span<const TeamStep> teams) const {
    PopulationPolicy policy;
    policy.packed = layout_;
    policy.obs_stride = network_.inputs().row;
    policy.phase = teams[0].sim.state().view().phase;
    const auto members = static_cast<int>(shape_.n_members), worlds = static_cast<int>(shape_.n_worlds);
    for (size_t k = 0; k < populations_.size(); ++k) {
      const auto part = [&](const TeamStep& step, size_t networks) {
        NetworkGroups groups;
        groups.networks = static_cast<const uint16_t*>(packed_[networks].const_data_ptr());
        groups.first_world = shape_.worlds(k).first;
        groups.obs = step.buffers.obs + network_.inputs().first;
        groups.act = actions_of(step);
        return groups;
      };
      NetworkGroups own = part(*step_of(populations_[k].team, teams), 2 * k);
      own.groups = members;
      own.worlds_per_group = own.group_step = worlds;
      own.world_step = 1;
      policy.part[policy.n_parts++] = own;
      const TeamStep* const opponents = step_of(1 - populations_[k].team, teams);
      if (!opponents) continue;
      NetworkGroups other = part(*opponents, 2 * k + 1);
      other.groups = other.world_step = worlds;
      other.worlds_per_group = members;
      other.group_step = 1;
      other.network = opponents_of(k);
      policy.part[policy.n_parts++] = other;
    }
    return policy;
  }

  const PackedMlp layout_;
  std::vector<at::Tensor> packed_;  // [networks, PackedMlp::size] members and opponents in turn
  at::Tensor work_;                 // int32: see PopulationPolicy
};

}  // namespace

PopulationController::PopulationController(const PopulationShape& shape, const Actor& network, bool greedy)
    : shape_(shape),
      network_(network),
      greedy_(greedy),
      opponent_(at::zeros({shape.n_populations, shape.n_worlds},
                          network.parameters().values().options().dtype(at::kInt).requires_grad(false))),
      scripted_(at::zeros_like(opponent_)),
      n_scripted_(static_cast<size_t>(shape.n_populations)) {}

void PopulationController::begin(const std::vector<Population>& populations) {
  GIGA_CHECK(populations.size() == static_cast<size_t>(shape_.n_populations), populations.size(), " populations, not ",
             shape_.n_populations);
  for (size_t k = 0; k < populations.size(); ++k) {
    const Population& p = populations[k];
    GIGA_CHECK(p.members.size(0) == shape_.n_members && p.members.is_contiguous() && p.opponents.is_contiguous() &&
                   static_cast<int64_t>(p.opponent.size()) == shape_.n_worlds,
               p.members.size(0), " members, ", p.opponent.size(), " opponents");
    opponent_[static_cast<int64_t>(k)].copy_(at::tensor(p.opponent, at::kInt));
    std::vector<int32_t> scripted;
    for (size_t e = 0; e < p.opponent.size(); ++e)
      if (p.opponent[e] < 0) scripted.push_back(static_cast<int32_t>(e));
    n_scripted_[k] = static_cast<int64_t>(scripted.size());
    scripted_[static_cast<int64_t>(k)].narrow(0, 0, n_scripted_[k]).copy_(at::tensor(scripted, at::kInt));
  }
  populations_ = populations;
  take();
}

void PopulationController::end() {
  drop();
  populations_.clear();
}

ObservationSet PopulationController::reads() const {
  ObservationSet set = network_.reads();
  for (const Population& p : populations_)
    for (const int32_t id : p.opponent)
      if (id < 0) set |= observations_of(script_of_network(id));
  return set;
}

void PopulationController::reads_by_world(int team, int64_t first, std::span<uint8_t> sets) const {
  GIGA_CHECK(first == 0 && std::ssize(sets) == shape_.n_populations * shape_.worlds_each(), sets.size(), " worlds");
  std::vector<uint8_t> of_episode(static_cast<size_t>(shape_.n_worlds));
  auto at = sets.begin();
  for (const Population& p : populations_) {
    for (size_t e = 0; e < of_episode.size(); ++e) {
      const int32_t opponent = p.opponent[e];
      const bool is_script = team != p.team && opponent < 0;
      of_episode[e] = (is_script ? observations_of(script_of_network(opponent)) : network_.reads()).bits();
    }
    for (int64_t member = 0; member < shape_.n_members; ++member)
      at = std::copy(of_episode.begin(), of_episode.end(), at);
  }
}

const TeamStep* PopulationController::step_of(int team, std::span<const TeamStep> teams) {
  const auto step = std::find_if(teams.begin(), teams.end(), [team](const TeamStep& s) { return s.team == team; });
  return step == teams.end() ? nullptr : &*step;
}

void PopulationController::act(std::span<const TeamStep> teams) {
  at::NoGradGuard no_grad;
  move_networks(teams);
  move_scripts(teams);
}

void PopulationController::act_share(int share, std::span<const TeamStep> teams) {
  at::NoGradGuard no_grad;
  share == 0 ? move_networks(teams) : move_scripts(teams);
}

void PopulationController::move_scripts(std::span<const TeamStep> teams) const {
  PopulationScriptsOfAll all;
  for (size_t k = 0; k < populations_.size(); ++k) {
    const Population& p = populations_[k];
    if (n_scripted_[k] == 0) continue;
    const TeamStep* const opponents = step_of(1 - p.team, teams);
    if (!opponents) continue;
    const TeamStep step = opponents->part(shape_.worlds(k));
    const Phase* phase = step.sim.state().view().phase + step.worlds.first;
    const int32_t* episodes = scripted_.const_data_ptr<int32_t>() + static_cast<int64_t>(k) * shape_.n_worlds;
    all.add({scripted_actions(Scripted::noop, step), phase, opponents_of(k), episodes, shape_.n_worlds,
             shape_.n_members, step.n()},
            n_scripted_[k]);
  }
  if (all.agents() > 0) teams[0].parallel_for.run(all, all.agents());
}

PopulationAct PopulationController::actions_of(const TeamStep& step) const {
  return {step.sim.params().actions, greedy_, step.draws(), step.buffers.action};
}

bool takes_fused_kernel(const Actor& network) {
  return network.precision() == Precision::fp16 && network.parameters().values().is_cuda();
}

std::unique_ptr<PopulationController> population_controller(const PopulationShape& shape, const Actor& network,
                                                            bool greedy) {
  if (!takes_fused_kernel(network)) return std::make_unique<LibTorchPopulations>(shape, network, greedy);
  const std::optional<SmallMlp> mlp = network.small_mlp();
  GIGA_CHECK(mlp && population_policy_runs(network.parameters().values().device().index()),
             "no fused kernel for these networks");
  return std::make_unique<FusedPopulations>(shape, network, greedy, *mlp);
}

}  // namespace giga
