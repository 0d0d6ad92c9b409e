#include "rollout/population_games.hpp"

#include <algorithm>
#include <map>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "rollout/shapes.hpp"
#include "rollout/tensors.hpp"
#include "sim/schedule.hpp"

namespace giga {
namespace {

/// With a limit, so that each episode ends.
SimSpec limited(const SimSpec& spec, std::optional<int> max_steps) {
  const SimSpec result = spec.with_time_limit();
  return max_steps ? result.cut_off_after(*max_steps) : result;
}

/// Whether any opponent is a script that looks at its observation, which networks of body views leave unread.
bool scripts_look(const std::vector<Population>& populations) {
  return std::any_of(populations.begin(), populations.end(), [](const Population& p) {
    return std::any_of(p.opponent.begin(), p.opponent.end(),
                       [](int32_t id) { return id < 0 && uses_observation(script_of_network(id)); });
  });
}

}  // namespace

PopulationGames::PopulationGames(const SimSpec& spec, const PopulationGamesOptions& options, const Actor& network,
                                 const RowRunner& rows)
    : options_(options), network_(network), rows_(rows) {
  SimOptions sim;
  sim.n_worlds = static_cast<int>(options.n_populations * n_worlds_each());
  sim.seed = options.seed;
  sim.draw_period = options.common_random_numbers ? options.n_worlds : 0;
  sim.on_done = OnDone::freeze;
  sim.episodes = options.n_rounds;
  sim.n_threads = options.n_threads;
  sim_ = make_simulator(limited(spec, options.max_steps), sim, rows.device());

  const Device device = rows.device();
  if (network.precision() == Precision::fp16 && device.is_cuda()) {
    const std::optional<SmallMlp> mlp = network.small_mlp();
    GIGA_CHECK(mlp && population_policy_runs(device.index), "no fused kernel for these networks on ", device.name());
    fused_.emplace(*mlp);
  }
  const auto floats = at::TensorOptions().dtype(at::kFloat).device(torch_device(device));
  const bool discrete = spec.params.actions == ActionKind::discrete;
  io_.obs_stride = spec.padded_observation_size();
  for (int team = 0; team < kNTeams; ++team) {
    const int64_t n = spec.params.n_team[team];
    Side& side = side_[team];
    side.obs = at::zeros({sim.n_worlds, n, spec.padded_observation_size()}, floats);
    side.action = discrete ? at::zeros({sim.n_worlds, n}, floats.dtype(at::kInt))
                           : at::zeros({sim.n_worlds, n, kActionSize}, floats);
    io_.team[team].obs = side.obs.data_ptr<float>();
    io_.team[team].action = side.action.data_ptr();
  }
  opponent_ = at::zeros({options.n_populations, options.n_worlds}, floats.dtype(at::kInt));
}

void PopulationGames::play(const std::vector<Population>& populations, uint32_t generation) {
  GIGA_CHECK(!populations.empty() && populations.size() <= static_cast<size_t>(options_.n_populations),
             populations.size(), " populations, room for ", options_.n_populations);
  at::NoGradGuard no_grad;
  for (size_t k = 0; k < populations.size(); ++k) {
    const Population& p = populations[k];
    GIGA_CHECK(p.members.size(0) == options_.n_members && p.members.is_contiguous() && p.opponents.is_contiguous() &&
                   static_cast<int64_t>(p.opponent.size()) == options_.n_worlds,
               p.members.size(0), " members, ", p.opponent.size(), " opponents");
    opponent_[static_cast<int64_t>(k)].copy_(at::tensor(p.opponent, at::kInt));
    if (!fused_) group_opponents(p, k);
  }
  packed_.clear();
  for (const Population& p : populations)
    if (fused_) packed_.insert(packed_.end(), {packed(p.members), packed(p.opponents)});
  io_.body_only = !network_.inputs().all() && !scripts_look(populations);
  // Draws are addressed by step: each episode has its own steps, two and one for each that is played (sim/step.hpp).
  const int limit = options_.n_rounds * sim_->params().max_episode_length;
  const uint32_t first_step = generation * static_cast<uint32_t>(limit + 2 * options_.n_rounds);
  wrap(reinterpret_cast<int32_t*>(sim_->state().view().draw_step), {sim_->n_worlds()}, sim_->device())
      .fill_(static_cast<int64_t>(static_cast<int32_t>(first_step)));

  const int device = rows_.device().index;
  PopulationPolicy fused;
  if (fused_) {
    fused = fused_policy(populations);
    work_ = at::empty({population_work(fused) + 1}, opponent_.options());
    fused.work = work_.const_data_ptr<int32_t>();
  }
  sim_->start(io_);
  for (int step = 0; step < limit; ++step) {
    if (step % kListPeriod == 0 && sim_->over()) break;
    if (fused_ && step % kListPeriod == 0) list_population_work(fused, work_.data_ptr<int32_t>(), device);
    if (fused_) launch_population_policy(fused, device);
    for (size_t k = 0; k < populations.size() && !fused_; ++k) {
      move_members(populations[k], k);
      move_opponents(populations[k], k);
    }
    move_scripts(populations);
    sim_->step(io_);
  }
}

at::Tensor PopulationGames::results(size_t k) const {
  const at::Tensor all = wrap(sim_->state().view().stats, {sim_->n_worlds(), kNStatRows}, sim_->device());
  return all.narrow(0, static_cast<int64_t>(k) * n_worlds_each(), n_worlds_each())
      .view({options_.n_members, options_.n_worlds, kNStatRows});
}

PopulationAct PopulationGames::act(int team, int64_t first_world) const {
  const StateView state = sim_->state().view();
  const SimOptions& sim = sim_->options();
  const int n = sim_->params().n_team[team];
  // With a period, a part of the worlds begins with a whole number of periods.
  const int64_t first_number = sim.draw_period > 0 ? sim.first_world : sim.first_world + first_world;
  const at::Tensor& action = side_[team].action;
  void* at = static_cast<char*>(action.data_ptr()) + first_world * action.stride(0) * action.itemsize();
  return {sim_->params().actions,
          options_.greedy,
          {state.draw_step + first_world, sim.seed, first_number, n, team, sim.draw_period},
          at};
}

at::Tensor PopulationGames::packed(const at::Tensor& networks) const {
  at::Tensor packed = at::empty({networks.size(0), fused_->size}, networks.options().dtype(at::kHalf));
  pack_population(*fused_, networks.const_data_ptr<float>(), networks.size(0), networks.size(1),
                  static_cast<uint16_t*>(packed.data_ptr()), rows_.device().index);
  return packed;
}

PopulationPolicy PopulationGames::fused_policy(const std::vector<Population>& populations) const {
  PopulationPolicy policy;
  policy.packed = *fused_;
  policy.obs_stride = network_.inputs().row;
  policy.phase = sim_->state().view().phase;
  const auto numbers_of = [](const at::Tensor& packed) {
    return static_cast<const uint16_t*>(packed.const_data_ptr());
  };
  const auto members = static_cast<int>(options_.n_members), episodes = static_cast<int>(options_.n_worlds);
  for (size_t k = 0; k < populations.size(); ++k) {
    const Population& p = populations[k];
    const int64_t first = static_cast<int64_t>(k) * n_worlds_each();
    const int other = 1 - p.team;
    policy.part[policy.n_parts++] = {numbers_of(packed_[2 * k]),
                                     nullptr,
                                     members,
                                     episodes,
                                     first,
                                     episodes,
                                     1,
                                     io_.team[p.team].obs + network_.inputs().first,
                                     act(p.team, 0)};
    policy.part[policy.n_parts++] = {numbers_of(packed_[2 * k + 1]),
                                     opponents_of(k),
                                     episodes,
                                     members,
                                     first,
                                     1,
                                     episodes,
                                     io_.team[other].obs + network_.inputs().first,
                                     act(other, 0)};
  }
  return policy;
}

PopulationScripts PopulationGames::scripts_of(const Population& p, size_t k) const {
  const int team = 1 - p.team;
  const int64_t first = static_cast<int64_t>(k) * n_worlds_each();
  const PopulationAct a = act(team, first);
  const StateView state = sim_->state().view();
  const at::Tensor& obs = side_[team].obs;
  const ScriptedActions script{Scripted::noop,
                               a.actions,
                               a.draws,
                               state.episode_length + first,
                               a.action,
                               sim_->params(),
                               obs.const_data_ptr<float>() + first * obs.stride(0),
                               static_cast<int>(obs.size(2))};
  return {script, state.phase + first, opponents_of(k), options_.n_worlds};
}

void PopulationGames::move_scripts(const std::vector<Population>& populations) const {
  PopulationScriptsOfAll all;
  for (size_t k = 0; k < populations.size(); ++k) {
    const std::vector<int32_t>& opponent = populations[k].opponent;
    if (std::none_of(opponent.begin(), opponent.end(), [](int32_t id) { return id < 0; })) continue;
    all.add(scripts_of(populations[k], k), n_worlds_each() * sim_->params().n_team[1 - populations[k].team]);
  }
  if (all.rows() > 0) rows_.run(all, all.rows());
}

const int32_t* PopulationGames::opponents_of(size_t k) const {
  return opponent_.const_data_ptr<int32_t>() + static_cast<int64_t>(k) * options_.n_worlds;
}

void PopulationGames::run_actions(int team, size_t k, const at::Tensor& head, const at::Tensor& networks,
                                  const int32_t* network) const {
  const int64_t first = static_cast<int64_t>(k) * n_worlds_each();
  const bool continuous = network_.actions() == ActionKind::continuous;
  rows_.run(PopulationActions{act(team, first), head.const_data_ptr<float>(), static_cast<int>(network_.head_size()),
                              networks.const_data_ptr<float>(), networks.size(1),
                              continuous ? network_.log_std_offset() : 0, network, options_.n_worlds},
            n_worlds_each() * sim_->params().n_team[team]);
}

void PopulationGames::move_members(const Population& p, size_t k) const {
  const at::Tensor& obs = side_[p.team].obs;
  const at::Tensor own = obs.narrow(0, static_cast<int64_t>(k) * n_worlds_each(), n_worlds_each());
  const at::Tensor head =
      network_.forward_members(p.members, own.view({options_.n_members, -1, obs.size(2)})).contiguous();
  run_actions(p.team, k, head, p.members, nullptr);
}

void PopulationGames::group_opponents(const Population& p, size_t k) {
  std::map<int32_t, std::vector<int64_t>> episodes;  // by network
  for (size_t e = 0; e < p.opponent.size(); ++e)
    if (p.opponent[e] >= 0) episodes[p.opponent[e]].push_back(static_cast<int64_t>(e));
  groups_.resize(std::max(groups_.size(), k + 1));
  groups_[k].clear();
  for (const auto& [network, list] : episodes)
    groups_[k].push_back({network, at::tensor(list, at::kLong).to(opponent_.device())});
}

// One evaluation for each network that plays: its episodes of all members. Scripts need no head.
void PopulationGames::move_opponents(const Population& p, size_t k) const {
  const int team = 1 - p.team;
  const at::Tensor& obs = side_[team].obs;
  const int64_t m = options_.n_members, e = options_.n_worlds, n = obs.size(1), d = obs.size(2);
  const at::Tensor all = obs.narrow(0, static_cast<int64_t>(k) * n_worlds_each(), n_worlds_each()).view({m, e, n, d});
  const at::Tensor head = at::empty({m, e, n, network_.head_size()}, obs.options());
  for (const OpponentGroup& group : groups_[k]) {
    const at::Tensor rows = all.index_select(1, group.worlds).view({1, -1, d});
    const at::Tensor out = network_.forward_members(p.opponents.narrow(0, group.network, 1), rows);
    head.index_copy_(1, group.worlds, out.view({m, group.worlds.size(0), n, -1}));
  }
  run_actions(team, k, head, p.opponents, opponents_of(k));
}

}  // namespace giga
