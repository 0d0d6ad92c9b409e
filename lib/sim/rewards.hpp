// Rewards: the terms of SPEC section 5, and the bookkeeping of episodes (returns, outcome, statistics).
#pragma once

#include "sim/paths.hpp"
#include "sim/sight.hpp"
#include "sim/world.hpp"

namespace giga {

GIGA_HD bool term_active(const SimParams& p, RewardTerm term) {
  return term == RewardTerm::idle_reward ? p.has_idle_reward : p.reward_weight[static_cast<int>(term)] > 0;
}

/// Number of opponents that agent i detects, and the damage units that it deals.
struct Dealt {
  int detected, damage;
};
GIGA_HD Dealt dealt_by(const SimParams& p, const WorldView& w, int i) {
  const int n = p.n_agents, words = words_for(n);
  Dealt d{0, 0};
  for (int a = 0; a < n; ++a) {
    d.detected += static_cast<int>(w.detected[static_cast<int64_t>(a) * words + i / 32] >> (i & 31) & 1u);
    d.damage += damage_units(p, w.tracked[static_cast<int64_t>(a) * n + i]);
  }
  return d;
}

GIGA_HD int observers_of(const SimParams& p, const WorldView& w, int i) {
  const int words = words_for(p.n_agents);
  int count = 0;
  for (int k = 0; k < words; ++k)
    for (uint32_t bits = w.detected[static_cast<int64_t>(i) * words + k]; bits; bits &= bits - 1) ++count;
  return count;
}

/// By how much agent i's own flight in this step has shortened its way to the nearest living opponent, seen or not,
/// round obstacles; map units. Over a flight to an opponent that stays where it is this adds up to the way (shaping by
/// a potential, Ng et al. 1999). w.next holds where agents were before the step.
GIGA_HD float way_gained(const SimParams& p, const WorldView& w, int i) {
  float nearest = -1;
  int target = -1;
  for (int a = 0; a < p.n_agents; ++a) {
    if (p.team_of(a) == p.team_of(i) || !w.alive[a]) continue;
    const float way = way_to(p, w, w.x[i], w.y[i], a);
    if (target >= 0 && way >= nearest) continue;
    nearest = way;
    target = a;
  }
  return target >= 0 ? way_to(p, w, w.next[i], w.next[p.n_agents + i], target) - nearest : 0.0f;
}

/// The unscaled value of one term for agent i: the table of SPEC section 5, then ours.
GIGA_HD float term_value(const SimParams& p, const WorldView& w, RewardTerm term, int i) {
  const float c = p.reward_weight[static_cast<int>(term)];
  const int team = p.team_of(i);
  const float alive = w.alive[i] ? 1.0f : 0.0f, was_alive = w.was_alive[i] ? 1.0f : 0.0f;
  const uint8_t flags = w.flags[i];
  switch (term) {
    case RewardTerm::hit_waypoint:
      return (flags & kHitWaypoint) ? c : 0.0f;
    case RewardTerm::idle_reward:
      return p.agents.idle_reward[i];
    case RewardTerm::defeat_one_opponent: {
      const int own_change = w.counts[kAlive0 + team] - w.counts[kWasAlive0 + team];
      const int other_change = w.counts[kAlive1 - team] - w.counts[kWasAlive1 - team];
      return c * alive * static_cast<float>(own_change - other_change) /
             static_cast<float>(w.counts[kAlive0 + team] + 1);
    }
    case RewardTerm::detection:
      return c * kDt * alive *
             (0.5f * static_cast<float>(dealt_by(p, w, i).detected) - 0.2f * static_cast<float>(observers_of(p, w, i)));
    case RewardTerm::damage:
      return c * kDt * alive * (static_cast<float>(dealt_by(p, w, i).damage) - 0.5f * w.taken[i]);
    case RewardTerm::idle:
      return -c * 0.001f * alive;
    case RewardTerm::collision_agent:
      return (flags & kHitAgent) ? -c : 0.0f;
    case RewardTerm::collision_obstacle: {
      // The original multiplies by `alive` after death, so this term never pays; `corrected` uses alive-before (Q7).
      const float hits = ((flags & kOutOfBounds) ? 1.0f : 0.0f) + ((flags & kHitObstacle) ? 1.0f : 0.0f);
      return -c * hits * (p.original() ? alive : was_alive);
    }
    case RewardTerm::agent_disabled:
      return -c * (1.0f - alive) * was_alive;
    case RewardTerm::game_won:
      return w.counts[kAlive1 - team] == 0 ? c * alive : 0.0f;
    case RewardTerm::approach:
      return c * alive * way_gained(p, w, i);
  }
  return 0.0f;
}

/// What a term's value is worth to the reward of an agent that lived before the step: the factor, the division by all
/// agents (Q12).
GIGA_HD float scale_term(const SimParams& p, const WorldView& w, RewardTerm term, float value) {
  const float scaled = term == RewardTerm::game_won ? value : *w.reward_factor * value;
  return p.divide_reward_by_team_size ? scaled / static_cast<float>(p.n_agents) : scaled;
}

/// All terms of agent i and their sum.
GIGA_HD void compute_reward(const SimParams& p, WorldView& w, int i) {
  float sum = 0, won = 0;
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    if (!term_active(p, term)) continue;
    const float value = term_value(p, w, term, i);
    w.terms[t * p.n_agents + i] = value;
    (term == RewardTerm::game_won ? won : sum) += value;
  }
  float reward = *w.reward_factor * sum + won;
  if (p.divide_reward_by_team_size) reward /= static_cast<float>(p.n_agents);
  w.reward[i] = w.was_alive[i] ? reward : 0.0f;
}

/// Adds the step to the episode's sums: item 0 to 1 = a team's returns, then one item per team and term.
constexpr int kNBookItems = kNTeams + kNTeams * kNRewardTerms;
GIGA_HD void keep_books(const SimParams& p, WorldView& w, int item) {
  if (item < kNTeams) {
    float sum = 0, masked = 0;
    for (int i = 0; i < p.n_agents; ++i) {
      if (p.team_of(i) != item) continue;
      sum += w.reward[i];
      if (w.alive[i] && !w.counts[kDone]) masked += w.reward[i];
    }
    w.returns[item] += sum;
    w.returns_masked[item] += masked;
    return;
  }
  const int team = (item - kNTeams) / kNRewardTerms, t = (item - kNTeams) % kNRewardTerms;
  const RewardTerm term = static_cast<RewardTerm>(t);
  if (!term_active(p, term)) return;
  float sum = 0;
  for (int i = 0; i < p.n_agents; ++i)
    if (p.team_of(i) == team && w.was_alive[i]) sum += w.terms[t * p.n_agents + i];
  w.term_returns[team * kNRewardTerms + t] += scale_term(p, w, term, sum);
}

/// Counts a team's living agents into w.counts[first + team].
GIGA_HD void count_team(const SimParams& p, WorldView& w, const uint8_t* alive, int first, int team) {
  int count = 0;
  for (int i = 0; i < p.n_agents; ++i)
    if (p.team_of(i) == team && alive[i]) ++count;
  w.counts[first + team] = count;
}

/// The team that is ahead, or a tie.
GIGA_HD Outcome leader(bool team_0, bool team_1) {
  return team_0 == team_1 ? Outcome::tie : (team_0 ? Outcome::team_0 : Outcome::team_1);
}

/// Who has won an episode that was undecided before this step: what a win is (WinRule) stands here and nowhere else.
/// By elimination the first wipe-out decides, in whatever step it comes; all else is decided when the episode ends.
GIGA_HD Outcome outcome_of(const WinRule& win, const int32_t* alive, const float* score, Done done) {
  const bool gone0 = alive[0] == 0, gone1 = alive[1] == 0;
  if (win.by == WinBy::elimination && (gone0 || gone1)) return leader(!gone0, !gone1);
  if (done == Done::running) return Outcome::open;
  if (win.by == WinBy::waypoints && score[0] != score[1]) return leader(score[0] > score[1], score[1] > score[0]);
  if (done == Done::terminated) return Outcome::tie;  // the time limit did not come
  return leader(win.at_time_limit == LimitWinner::team_0, win.at_time_limit == LimitWinner::team_1);
}

/// 4.6: the episode's length, its end and its outcome.
GIGA_HD void end_of_step(const SimParams& p, WorldView& w) {
  const bool gone0 = w.counts[kAlive0] == 0, gone1 = w.counts[kAlive1] == 0;
  *w.episode_length += 1;
  Done done = Done::running;
  if (p.max_episode_length > 0 && *w.episode_length >= p.max_episode_length) done = Done::truncated;
  if ((gone0 && gone1) || (p.episode_ends_one_team_dead && (gone0 || gone1))) done = Done::terminated;
  if (*w.outcome == Outcome::open) *w.outcome = outcome_of(p.win, w.counts + kAlive0, w.score, done);
  w.counts[kDone] = static_cast<int32_t>(done);
}

/// Where the statistics count an agent at the end of its episode; of team 0.
GIGA_HD EpisodeStat end_of_agent(Death death) {
  switch (death) {
    case Death::none:
      return EpisodeStat::survivors_0;
    case Death::damage:
      return EpisodeStat::deaths_damage_0;
    case Death::agent:
      return EpisodeStat::deaths_agent_0;
    case Death::obstacle:
      return EpisodeStat::deaths_obstacle_0;
    case Death::out_of_bounds:
      break;
  }
  return EpisodeStat::deaths_bounds_0;
}

/// Moves the sums of a finished episode into the statistics; item as in keep_books.
GIGA_HD void close_books(const SimParams& p, WorldView& w, int item) {
  const auto stat = [&w](EpisodeStat s, int offset = 0) -> float& { return w.stats[static_cast<int>(s) + offset]; };
  if (item >= kNTeams) {
    const int k = item - kNTeams;
    w.stats[kNEpisodeStats + k] += w.term_returns[k];
    w.term_returns[k] = 0;
    return;
  }
  if (item == 0) {
    stat(EpisodeStat::episodes) += 1;
    stat(EpisodeStat::length) += static_cast<float>(*w.episode_length);
    const EpisodeStat result = *w.outcome == Outcome::team_0   ? EpisodeStat::wins_0
                               : *w.outcome == Outcome::team_1 ? EpisodeStat::wins_1
                                                               : EpisodeStat::ties;
    stat(result) += 1;
    if (*w.phase == Phase::truncated) stat(EpisodeStat::truncated) += 1;
  }
  stat(EpisodeStat::return_0, item) += w.returns[item];
  stat(EpisodeStat::return_masked_0, item) += w.returns_masked[item];
  stat(EpisodeStat::score_0, item) += w.score[item];
  for (int i = 0; i < p.n_agents; ++i)
    if (p.team_of(i) == item) stat(end_of_agent(w.death[i]), item) += 1;
  w.returns[item] = w.returns_masked[item] = w.score[item] = 0;
}

}  // namespace giga
