#include "learn/opponents/league.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "core/seeds.hpp"
#include "learn/opponents/guests.hpp"
#include "learn/team_policy.hpp"
#include "policy/parameters.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Statistics of games that are counted: episodes, wins of a team, ties.
constexpr int64_t kCounts = 3;

at::Tensor stats_of(const Simulator& sim) {
  return wrap(sim.state().view().stats, {sim.n_worlds(), kNStatRows}, sim.device());
}

GameCount game_count(const double* counts) { return {counts[0], counts[1], counts[2]}; }

}  // namespace

League::League(const LoadedRun& run, const WorldShares& worlds, std::array<const Actor*, kNTeams> actors,
               const ParallelFor& parallel_for, const SumOverRanks& sum)
    : config_(run.config.opponents),
      guests_are_saved_(run.policies_are_saved),
      seed_(seed_of(run.config.seed, Purpose::training)),
      device_(torch_device(parallel_for.device())),
      shares_(worlds),
      sum_(sum),
      learners_(policies_controller(*actors[0], *actors[1])),
      counts_(at::zeros({shares_.n_worlds()}, at::TensorOptions().dtype(at::kByte).device(device_))) {
  if (config_.pool_size == 0) return;
  const Precision precision = precision_on(run, parallel_for.device());
  std::array<at::Tensor, kNTeams> guests;
  if (!guests_are_saved_) guests = load_guests(run, actors, parallel_for.device());
  past_.reserve(kNTeams);
  for (const Actor* actor : actors) {
    past_.push_back({actor,
                     OpponentPool(config_.pool_size, GroupPolicy::row_of(*actor), guests[past_.size()]),
                     GroupPolicy(*actor, algorithm_of(run.config).policy(run.config).actor, precision),
                     {},
                     {},
                     {},
                     {}});
    // Of a fixed number of groups, so that a run may go on with other shares.
    Past& past = past_.back();
    set_rows(past, std::vector<int32_t>(std::min<size_t>(static_cast<size_t>(config_.pool_size), kMostGroups)));
    if (past.pool.n_guests() > 0) draw_rows(static_cast<int>(past_.size()) - 1, 0);
    past.networks = past.pool.networks().index_select(0, past.row_index);
    past.policy.set(past.networks);
  }
}

Side League::side(int team) const {
  const int other = 1 - team;                                                 // that learns where this one is frozen
  std::vector<std::pair<std::shared_ptr<TeamController>, ShardRange>> parts;  // of each shard
  const auto add_scripts = [&] {
    const auto n = static_cast<int64_t>(config_.scripted.size());
    for (int64_t k = 0; k < n; ++k) {
      ShardRange worlds = shares_.scripts(other);
      worlds.in_shard = part_of(worlds.in_shard, k, n);
      parts.emplace_back(script_controller(config_.scripted[static_cast<size_t>(k)]), worlds);
    }
  };
  const auto add_past = [&] {
    if (!past_.empty())
      parts.emplace_back(group_controller(past_[static_cast<size_t>(team)].policy), shares_.pool(other));
  };
  const auto add_learner = [&] { parts.emplace_back(learners_, shares_.learning(team)); };
  if (team == 0) {
    add_learner();
    add_past();
    add_scripts();
  } else {
    add_scripts();
    add_past();
    add_learner();
  }
  Side side;
  for (int64_t shard = 0; shard < shares_.n_shards; ++shard)
    for (const auto& [controller, worlds] : parts)
      if (worlds.count() > 0) side.push_back({controller, worlds.of(shard)});
  return side;
}

void League::set_rows(Past& past, std::vector<int32_t> rows) const {
  past.row = std::move(rows);
  past.row_index = at::tensor(past.row, at::kLong).slice(0, 0, shares_.groups).to(device_);
}

void League::draw_rows(int team, uint32_t update) {
  Past& past = past_[static_cast<size_t>(team)];
  const std::vector<double> weights = past.pool.weights(config_);
  std::vector<int32_t> rows(past.row.size());
  for (size_t g = 0; g < rows.size(); ++g)
    rows[g] = draw_opponent(weights, {seed_, update, 1 - team}, static_cast<uint32_t>(g));
  set_rows(past, std::move(rows));
}

void League::begin() {
  at::NoGradGuard no_grad;
  for (Past& past : past_) {
    past.pool.set_present(GroupPolicy::row_of(*past.actor));
    at::index_select_out(past.networks, past.pool.networks(), 0, past.row_index);
  }
}

/// -> [shards, worlds of each, kCounts]
at::Tensor League::counts_of(const at::Tensor& stats, const ShardRange& worlds, int team) const {
  const at::Tensor of_worlds = in_shards(stats, worlds, 0);
  const auto column = [&](EpisodeStat stat) { return of_worlds.select(2, static_cast<int64_t>(stat)); };
  return at::stack(
      {column(EpisodeStat::episodes), column(of_team(EpisodeStat::wins_0, team)), column(EpisodeStat::ties)}, 2);
}

void League::count(const Simulator& sim) {
  at::NoGradGuard no_grad;
  const at::Tensor stats = stats_of(sim);
  std::vector<at::Tensor> sums = {in_shards(stats, shares_.self_play(), 0).flatten(0, 1).sum(0, false, at::kDouble)};
  for (int team = 0; team < kNTeams; ++team) {
    if (!past_.empty()) {
      const ShardRange worlds = shares_.pool(team);
      const at::Tensor counts = counts_of(stats, worlds, team), began = in_shards(counts_, worlds, 0);
      sums.push_back((counts * began.unsqueeze(2))
                         .view({shares_.n_shards, shares_.groups, shares_.group_size, kCounts})
                         .sum(at::IntArrayRef({0, 2}), false, at::kDouble)
                         .flatten());
      began.logical_or_(counts.select(2, 0) > 0);
    }
    sums.push_back(counts_of(stats, shares_.scripts(team), team).flatten(0, 1).sum(0, false, at::kDouble));
  }
  sums_ = at::cat(sums);
  sum_(sums_);
}

void League::read(EpisodeStats& self_play, std::array<LeagueRecord, kNTeams>& record) {
  const at::Tensor host = sums_.cpu();
  const double* next = host.const_data_ptr<double>();
  std::copy_n(next, self_play.rows.size(), self_play.rows.begin());
  next += self_play.rows.size();
  for (size_t team = 0; team < kNTeams; ++team) {
    record[team] = {};
    for (int64_t g = 0; !past_.empty() && g < shares_.groups; ++g, next += kCounts) {
      Past& met = past_[1 - team];
      const int32_t row = met.row[static_cast<size_t>(g)];
      const GameCount games = game_count(next);
      if (row == 0) continue;  // the other team as it is
      record[team].pool += games;
      met.pool.note(row, games.episodes, games.points());
    }
    if (!past_.empty()) past_[team].since_kept += record[team].pool;
    record[team].scripts = game_count(next);
    next += kCounts;
  }
}

bool League::is_promoted(size_t team) const {
  return config_.pool_promotion == PoolPromotion::always || past_[1 - team].pool.n_past() == 0 ||
         past_[team].since_kept.is_evidence();
}

bool League::end(int64_t updates_done, const Simulator& sim) {
  if (updates_done % config_.pool_every_updates != 0) return false;
  at::NoGradGuard no_grad;
  // Judged before either pool grows.
  std::array<bool, kNTeams> promoted{};
  for (size_t team = 0; team < past_.size(); ++team) promoted[team] = is_promoted(team);
  for (size_t team = 0; team < past_.size(); ++team) {
    Past& past = past_[team];
    past.pool.set_present(GroupPolicy::row_of(*past.actor));
    if (promoted[team]) {
      past.pool.keep();
      past.since_kept = {};
    } else {
      past.pool.fade();
    }
    draw_rows(static_cast<int>(team), static_cast<uint32_t>(updates_done));
  }
  counts_.copy_(wrap(sim.state().view().episode_length, {shares_.n_worlds()}, sim.device()) == 0);
  return true;
}

void League::save_worlds(const std::string& prefix, NamedArrays& out) const {
  if (!past_.empty()) out.push_back(to_array(prefix + "counts", counts_));
}

void League::load_worlds(const std::string& prefix, const NamedArrays& in) {
  if (!past_.empty()) from_array(find_array(in, prefix + "counts"), counts_);
}

void League::save(const std::string& prefix, NamedArrays& out) const {
  for (size_t team = 0; team < past_.size(); ++team) {
    const std::string place = cat(prefix, "team_", team, "/");
    past_[team].pool.save(place, out);
    out.push_back(make_array<int32_t>(place + "row", past_[team].row));
    const GameCount& since = past_[team].since_kept;
    if (config_.pool_promotion == PoolPromotion::evidence)
      out.push_back(make_array<double>(place + "since_kept", {since.episodes, since.wins, since.ties}));
  }
}

bool League::load(const std::string& prefix, const NamedArrays& in) {
  bool drawn_anew = false;
  for (size_t team = 0; team < past_.size(); ++team) {
    Past& past = past_[team];
    const std::string place = cat(prefix, "team_", team, "/");
    const OpponentPool::Loaded saved = past.pool.load(place, in, guests_are_saved_);
    if (config_.pool_promotion == PoolPromotion::evidence) {
      const std::vector<double> since = array_values<double>(find_array(in, place + "since_kept"));
      if (since.size() != 3)
        throw InputError(cat("array '", place, "since_kept' has ", since.size(), " numbers, expected 3"));
      past.since_kept = {since[0], since[1], since[2]};
    }
    std::vector<int32_t> rows = array_values<int32_t>(find_array(in, place + "row"));
    if (rows.size() != past.row.size())
      throw InputError(cat("array '", place, "row' has ", rows.size(), " numbers, expected ", past.row.size()));
    for (const int32_t row : rows)
      if (row < 0 || row > saved.last_row || (row > 0 && row <= config_.pool_size && !past.pool.has(row)))
        throw InputError(cat("array '", place, "row' holds ", row, ", the pool has ", past.pool.size(), " policies"));
    if (saved.other_guests) {  // a row may mean somebody else now
      past.row = std::move(rows);
      draw_rows(static_cast<int>(team), 0);
      drawn_anew = true;
    } else {
      set_rows(past, std::move(rows));
    }
  }
  if (drawn_anew) forget_games();
  return drawn_anew;
}

}  // namespace giga
