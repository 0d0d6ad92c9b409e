#include "learn/opponents/league.hpp"

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/error.hpp"
#include "core/seeds.hpp"
#include "learn/opponents/guests.hpp"
#include "learn/team_policy.hpp"
#include "math/earlier_opponent.hpp"
#include "policy/parameters.hpp"
#include "policy/run_elementwise.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// Statistics of games that are counted: episodes, wins of a team, ties.
constexpr int64_t kCounts = 3;
/// The row of an opponent whose policy has left the pool: it plays on, and nobody notes its results.
constexpr int32_t kGone = -1;
/// Before the first draw: longer ago than any game is.
constexpr int32_t kLongAgo = std::numeric_limits<int32_t>::min();
constexpr int64_t kNow = 0, kEarlier = 1;  // of Past::networks

at::Tensor stats_of(const Simulator& sim) {
  return wrap(sim.state().view().stats, {sim.n_worlds(), kNStatRows}, sim.device());
}

at::Tensor lengths_of(const Simulator& sim) {
  return wrap(sim.state().view().episode_length, {sim.n_worlds()}, sim.device());
}
/// The bits of draw_step.
at::Tensor steps_of(const Simulator& sim) {
  return wrap(reinterpret_cast<const int32_t*>(sim.state().view().draw_step), {sim.n_worlds()}, sim.device());
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
      counts_(at::zeros({shares_.n_worlds()}, at::TensorOptions().dtype(at::kByte).device(device_))),
      drawn_at_(at::full({shares_.n_worlds()}, kLongAgo, counts_.options().dtype(at::kInt))),
      earlier_(at::zeros_like(counts_)) {
  if (config_.pool_size == 0) return;
  const Precision precision = precision_on(run, parallel_for.device());
  std::array<at::Tensor, kNTeams> guests;
  if (!guests_are_saved_) guests = load_guests(run, actors, parallel_for.device());
  past_.reserve(kNTeams);
  const auto n_rows = static_cast<size_t>(std::min<int64_t>(config_.pool_size, kMostGroups));
  for (const Actor* actor : actors) {
    const GroupPolicy policy(*actor, algorithm_of(run.config).policy(run.config).actor, precision);
    OpponentPool pool(config_.pool_size, GroupPolicy::row_of(*actor), guests[past_.size()]);
    past_.push_back(
        {actor, std::move(pool), {policy, policy, drawn_at_, at::zeros({shares_.groups}, counts_.options())}});
    Past& past = past_.back();
    past.waits.resize(n_rows);
    past.networks = past.pool.networks().narrow(0, 0, 1).expand({2, static_cast<int64_t>(n_rows), -1}).contiguous();
    set_rows(past, std::vector<int32_t>(n_rows));
    if (past.pool.n_guests() > 0) draw_rows(static_cast<int>(past_.size()) - 1, 0);
    past.policies.now.set(past.networks[kNow].narrow(0, 0, shares_.groups));
    past.policies.earlier.set(past.networks[kEarlier].narrow(0, 0, shares_.groups));
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
      parts.emplace_back(group_controller(past_[static_cast<size_t>(team)].policies), shares_.pool(other));
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
  std::vector<int64_t> present;
  for (size_t g = 0; g < past.row.size(); ++g)
    if (past.row[g] == 0) present.push_back(static_cast<int64_t>(g));
  past.present = at::tensor(present, at::kLong).to(device_);
}

/// The opponents of the groups that do not wait; those that they had become the earlier ones.
void League::draw_rows(int team, uint32_t update) {
  at::NoGradGuard no_grad;
  Past& past = past_[static_cast<size_t>(team)];
  const std::vector<double> weights = past.pool.weights(config_);
  std::vector<int32_t> rows = past.row;
  std::vector<int64_t> drawn;
  for (size_t g = 0; g < rows.size(); ++g) {
    if (past.waits[g]) continue;
    rows[g] = draw_opponent(weights, {seed_, update, 1 - team}, static_cast<uint32_t>(g));
    drawn.push_back(static_cast<int64_t>(g));
  }
  set_rows(past, std::move(rows));
  const at::Tensor groups = at::tensor(drawn, at::kLong).to(device_), now = past.networks[kNow];
  past.networks[kEarlier].index_copy_(0, groups, now.index_select(0, groups));
  take_networks(past, drawn);
}

/// From the pool, by their rows.
void League::take_networks(Past& past, const std::vector<int64_t>& groups) const {
  std::vector<int64_t> rows;
  for (const int64_t g : groups) rows.push_back(past.row[static_cast<size_t>(g)]);
  const at::Tensor from = at::tensor(rows, at::kLong).to(device_), to = at::tensor(groups, at::kLong).to(device_);
  past.networks[kNow].index_copy_(0, to, past.pool.networks().index_select(0, from));
}

void League::begin() {
  at::NoGradGuard no_grad;
  for (Past& past : past_) {
    past.pool.set_present(GroupPolicy::row_of(*past.actor));
    if (past.present.size(0) == 0) continue;
    past.networks[kNow].index_copy_(0, past.present,
                                    past.pool.networks().narrow(0, 0, 1).expand({past.present.size(0), -1}));
  }
}

/// The worlds of [W] in which policies of a team play: [shards, groups, worlds of each], a view.
at::Tensor League::by_group(const at::Tensor& of_worlds, int team) const {
  return in_shards(of_worlds, shares_.pool(1 - team), 0).view({shares_.n_shards, shares_.groups, shares_.group_size});
}

/// In which worlds and groups the earlier opponent still plays.
void League::note_earlier(const Simulator& sim) {
  if (past_.empty() || shares_.pooled() == 0) return;
  const StateView state = sim.state().view();
  run_elementwise(
      drawn_at_,
      NoteEarlierGames{state.episode_length, state.draw_step,
                       reinterpret_cast<uint32_t*>(drawn_at_.data_ptr<int32_t>()), earlier_.data_ptr<uint8_t>()},
      shares_.n_worlds());
  for (int team = 0; team < kNTeams; ++team)
    at::amax_out(past_[static_cast<size_t>(team)].policies.plays, by_group(earlier_, team), {0, 2});
}

void League::set_any_plays(bool any) {
  for (Past& past : past_) past.policies.any_plays = any;
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
  note_earlier(sim);
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
      sums.push_back(past_[static_cast<size_t>(1 - team)].policies.plays.to(at::kDouble));
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
  set_any_plays(false);
  for (size_t team = 0; team < kNTeams; ++team) {
    record[team] = {};
    for (int64_t g = 0; !past_.empty() && g < shares_.groups; ++g, next += kCounts) {
      Past& met = past_[1 - team];
      const int32_t row = met.row[static_cast<size_t>(g)];
      const GameCount games = game_count(next);
      if (row == 0) continue;  // the other team as it is
      record[team].pool += games;
      if (row != kGone) met.pool.note(row, games.episodes, games.points());
    }
    for (int64_t g = 0; !past_.empty() && g < shares_.groups; ++g, ++next) {
      TwoGenerations& policies = past_[1 - team].policies;
      past_[1 - team].waits[static_cast<size_t>(g)] = *next > 0;
      policies.any_plays = policies.any_plays || *next > 0;
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

void League::end(int64_t updates_done, const Simulator& sim, const std::array<bool, kNTeams>& fallen) {
  if (updates_done % config_.pool_every_updates != 0) return;
  at::NoGradGuard no_grad;
  // Judged before either pool grows.
  std::array<bool, kNTeams> promoted{};
  for (size_t team = 0; team < past_.size(); ++team) promoted[team] = is_promoted(team);
  for (size_t team = 0; team < past_.size(); ++team) {
    Past& past = past_[team];
    past.pool.set_present(GroupPolicy::row_of(*past.actor));
    if (promoted[team] && !fallen[team]) {
      const auto kept = static_cast<int32_t>(past.pool.keep());
      if (kept > 0) std::replace(past.row.begin(), past.row.end(), kept, kGone);
      past.since_kept = {};
    } else {
      past.pool.fade();
    }
    if (fallen[team]) past.since_kept = {};  // of those who are no more
    draw_rows(static_cast<int>(team), static_cast<uint32_t>(updates_done));
    begin_games(static_cast<int>(team), sim);
  }
  note_earlier(sim);
  set_any_plays(true);
}

/// The games that begin from here on are against the opponents that were drawn.
void League::begin_games(int team, const Simulator& sim) {
  if (shares_.pooled() == 0) return;
  const std::vector<uint8_t>& waits = past_[static_cast<size_t>(team)].waits;
  const at::Tensor stay = at::tensor(waits, at::kByte).slice(0, 0, shares_.groups).to(device_).view({1, -1, 1}) != 0;
  const auto set = [&](const at::Tensor& of_worlds, const at::Tensor& value) {
    const at::Tensor now = by_group(of_worlds, team);
    now.copy_(at::where(stay, now, by_group(value, team)));
  };
  set(counts_, (lengths_of(sim) == 0).to(at::kByte));
  set(drawn_at_, steps_of(sim));
}

void League::forget_games(const Simulator& sim) {
  counts_.zero_();
  drawn_at_.copy_(steps_of(sim) - lengths_of(sim));
  for (Past& past : past_) std::fill(past.waits.begin(), past.waits.end(), uint8_t{0});
}

void League::save_worlds(const std::string& prefix, NamedArrays& out) const {
  if (past_.empty()) return;
  out.push_back(to_array(prefix + "counts", counts_));
  out.push_back(to_array(prefix + "drawn_at", drawn_at_));
}

void League::load_worlds(const std::string& prefix, const NamedArrays& in, const Simulator& sim) {
  if (past_.empty()) return;
  forget_games(sim);  // checkpoints of before there were two generations do not say when opponents were drawn
  from_array(find_array(in, prefix + "counts"), counts_);
  if (const NamedArray* drawn_at = look_for_array(in, prefix + "drawn_at")) from_array(*drawn_at, drawn_at_);
}

void League::save(const std::string& prefix, NamedArrays& out) const {
  for (size_t team = 0; team < past_.size(); ++team) {
    const std::string place = cat(prefix, "team_", team, "/");
    past_[team].pool.save(place, out);
    out.push_back(make_array<int32_t>(place + "row", past_[team].row));
    out.push_back(to_array(place + "met", past_[team].networks));
    const GameCount& since = past_[team].since_kept;
    if (config_.pool_promotion == PoolPromotion::evidence)
      out.push_back(make_array<double>(place + "since_kept", {since.episodes, since.wins, since.ties}));
  }
}

bool League::load(const std::string& prefix, const NamedArrays& in) {
  at::NoGradGuard no_grad;
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
    // An older checkpoint has neither: its opponents are those of its rows, and no earlier one plays.
    const bool has_met = look_for_array(in, prefix + "drawn_at") || look_for_array(in, place + "met");
    if (has_met) find_array(in, prefix + "drawn_at");
    if (has_met) from_array(find_array(in, place + "met"), past.networks);
    std::vector<int32_t> rows = array_values<int32_t>(find_array(in, place + "row"));
    if (rows.size() != past.row.size())
      throw InputError(cat("array '", place, "row' has ", rows.size(), " numbers, expected ", past.row.size()));
    for (const int32_t row : rows)
      if (row < (has_met ? kGone : 0) || row > saved.last_row ||
          (row > 0 && row <= config_.pool_size && !past.pool.has(row)))
        throw InputError(cat("array '", place, "row' holds ", row, ", the pool has ", past.pool.size(), " policies"));
    set_rows(past, std::move(rows));
    if (saved.other_guests) {  // a row may mean somebody else now
      std::fill(past.waits.begin(), past.waits.end(), uint8_t{0});
      draw_rows(static_cast<int>(team), 0);
      drawn_anew = true;
    } else if (!has_met) {
      std::vector<int64_t> all(past.row.size());
      std::iota(all.begin(), all.end(), 0);
      take_networks(past, all);
    }
    past.policies.plays.fill_(1);  // until `count` knows
  }
  set_any_plays(true);
  return drawn_anew;
}

}  // namespace giga
