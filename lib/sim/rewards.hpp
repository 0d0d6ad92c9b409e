// Rewards: the terms of rules 5, then ours, and their sum.
#pragma once

#include "sim/paths.hpp"
#include "sim/sight.hpp"
#include "sim/world.hpp"

namespace giga {

GIGA_HD bool term_active(const Parameters auto& p, RewardTerm term) {
  return term == RewardTerm::idle_reward ? p.has_idle_reward : p.reward_weight[static_cast<int>(term)] > 0;
}

/// Term number k of those that are active, and how they are kept.
GIGA_HD int active_term(const Parameters auto& p, int k) { return static_cast<int>(p.active_terms >> (4 * k) & 15u); }
static_assert(kNRewardTerms <= 16, "four bits tell of a term");
inline void list_active_terms(SimParams& p) {
  p.active_terms = 0;
  p.n_active_terms = 0;
  for (int t = 0; t < kNRewardTerms; ++t)
    if (term_active(p, static_cast<RewardTerm>(t)))
      p.active_terms |= static_cast<uint64_t>(t) << (4 * p.n_active_terms++);
}

/// Number of opponents that agent i detects, and the damage units that it deals.
struct Dealt {
  int detected, damage;
};
GIGA_HD Dealt dealt_by(const Parameters auto& p, const World auto& w, int i) {
  const int n = p.n_agents, words = words_for(n);
  Dealt d{0, 0};
  for_team(p, 1 - p.team_of(i), [&](int a, int) {
    d.detected += static_cast<int>(w.detected[static_cast<int64_t>(a) * words + i / 32] >> (i & 31) & 1u);
    d.damage += damage_units(p, w.tracked[static_cast<int64_t>(a) * n + i]);
  });
  return d;
}

GIGA_HD int observers_of(const Parameters auto& p, const World auto& w, int i) {
  const int words = words_for(p.n_agents);
  int count = 0;
  for (int k = 0; k < words; ++k)
    for (uint32_t bits = w.detected[static_cast<int64_t>(i) * words + k]; bits; bits &= bits - 1) ++count;
  return count;
}

/// By how much agent i's own flight in this step has shortened its way to the nearest living opponent, seen or not,
/// round obstacles; map units. Over a flight to an opponent that stays where it is this adds up to the way (shaping by
/// a potential, Ng et al. 1999). w.next holds where agents were before the step.
GIGA_HD float way_gained(const Parameters auto& p, const World auto& w, int i) {
  float nearest = -1;
  int target = -1;
  const int team = 1 - p.team_of(i), end = p.end_of(team);
  for (int a = p.first_of(team); a < end; ++a) {
    if (p.team_of(a) != team || !w.alive[a]) continue;
    const float way = way_to(p, w, w.x[i], w.y[i], a);
    if (target >= 0 && way >= nearest) continue;
    nearest = way;
    target = a;
  }
  return target >= 0 ? way_to(p, w, w.next[i], w.next[p.n_agents + i], target) - nearest : 0.0f;
}

/// The unscaled value of one term for agent i, who deals `dealt`: the table of rules 5.1.
GIGA_HD float term_value(const Parameters auto& p, const World auto& w, RewardTerm term, int i, Dealt dealt) {
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
      return divide(c * alive * static_cast<float>(own_change - other_change),
                    static_cast<float>(w.counts[kAlive0 + team] + 1));
    }
    case RewardTerm::detection:
      return c * kDt * alive *
             (0.5f * static_cast<float>(dealt.detected) - 0.2f * static_cast<float>(observers_of(p, w, i)));
    case RewardTerm::damage:
      return c * kDt * alive * (static_cast<float>(dealt.damage) - 0.5f * w.taken[i]);
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

/// What a term's value, in w.terms, is worth to the reward of an agent that lived before the step: the world's factor,
/// the division by all agents (Q12).
GIGA_HD float scale_term(const Parameters auto& p, const World auto& w, RewardTerm term, float value) {
  const float scaled = term == RewardTerm::game_won ? value : *w.reward_factor * value;
  return p.divide_reward_by_team_size ? divide(scaled, static_cast<float>(p.n_agents)) : scaled;
}

/// All terms of agent i and their sum.
GIGA_HD void compute_reward(const Parameters auto& p, World auto& w, int i) {
  Dealt dealt{0, 0};
  if (term_active(p, RewardTerm::detection) || term_active(p, RewardTerm::damage)) dealt = dealt_by(p, w, i);
  float sum = 0, won = 0;
  GIGA_UNROLL
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    if (!term_active(p, term)) continue;
    float value = term_value(p, w, term, i, dealt);
    if (p.has_term_factors) value *= p.term_factors[t];
    w.terms[t * p.n_agents + i] = value;
    (term == RewardTerm::game_won ? won : sum) += value;
  }
  float reward = *w.reward_factor * sum + won;
  if (p.divide_reward_by_team_size) reward = divide(reward, static_cast<float>(p.n_agents));
  w.reward[i] = w.was_alive[i] ? reward : 0.0f;
}

}  // namespace giga
