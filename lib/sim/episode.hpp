// Episodes: who lives, when one ends, who has won, and what is added up over one (returns, statistics).
#pragma once

#include "sim/rewards.hpp"
#include "sim/world.hpp"

namespace giga {

/// Agents of a team whose numbers are added up one after the other; then these sums are, so many at a time
/// (rules 17.5).
constexpr int kSumBlock = 64;

/// A sum over the agents of a team, of those whose worlds have tables of pairs: at most kSumBlock blocks.
class TeamSum {
 public:
  /// `slot`: its index in the team.
  GIGA_HD void add(float number, int slot) {
    block_ += number;
    if (slot % kSumBlock != kSumBlock - 1) return;
    blocks_ += block_;
    block_ = 0;
  }
  GIGA_HD float sum() const { return blocks_ + block_; }

 private:
  float blocks_ = 0, block_ = 0;
};

/// What agent i adds to an item of accumulate_episode.
GIGA_HD float masked_reward(const World auto& w, int i) { return w.alive[i] && !w.counts[kDone] ? w.reward[i] : 0.0f; }
GIGA_HD float term_of_step(const Parameters auto& p, const World auto& w, int t, int i) {
  return w.was_alive[i] ? w.terms[t * p.n_agents + i] : 0.0f;
}

/// Adds the step to the episode's sums: item 0 to 1 = a team's returns, then one item per team and active term.
GIGA_HD int n_step_items(const Parameters auto& p) { return kNTeams + kNTeams * p.n_active_terms; }
GIGA_HD void accumulate_episode(const Parameters auto& p, World auto& w, int item) {
  if (item < kNTeams) {
    const float returns = w.returns[item], returns_masked = w.returns_masked[item];  // asked for early, needed late
    TeamSum sum, masked;
    for_team(p, item, [&](int i, int slot) {
      sum.add(w.reward[i], slot);
      masked.add(masked_reward(w, i), slot);
    });
    w.returns[item] = returns + sum.sum();
    w.returns_masked[item] = returns_masked + masked.sum();
    return;
  }
  const int k = item - kNTeams, team = k >= p.n_active_terms ? 1 : 0, t = active_term(p, k - team * p.n_active_terms);
  const RewardTerm term = static_cast<RewardTerm>(t);
  float& total = w.term_returns[team * kNRewardTerms + t];
  const float before = total;
  TeamSum sum;
  for_team(p, team, [&](int i, int slot) { sum.add(term_of_step(p, w, t, i), slot); });
  total = before + scale_term(p, w, term, sum.sum());
}

/// Counts a team's living agents into w.counts[first + team].
GIGA_HD void count_team(const Parameters auto& p, World auto& w, const uint8_t* alive, int first, int team) {
  int count = 0;
  for_team(p, team, [&](int i, int) { count += alive[i] ? 1 : 0; });
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

/// Whether the episode ends with its step number `length`, after which nobody of a team lives (`gone`).
GIGA_HD Done done_after(const Parameters auto& p, bool gone0, bool gone1, int length) {
  Done done = Done::running;
  if (p.max_episode_length > 0 && length >= p.max_episode_length) done = Done::truncated;
  if ((gone0 && gone1) || (p.episode_ends_one_team_dead && (gone0 || gone1))) done = Done::terminated;
  return done;
}

/// Rules 4.6: the episode's length, its end and its outcome.
GIGA_HD void end_of_step(const Parameters auto& p, World auto& w) {
  const bool gone0 = w.counts[kAlive0] == 0, gone1 = w.counts[kAlive1] == 0;
  *w.episode_length += 1;
  const Done done = done_after(p, gone0, gone1, *w.episode_length);
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

/// Moves the sums of a finished episode into the statistics: item 0 to 1 = a team's, then one item per team and term.
constexpr int kNEpisodeItems = kNTeams + kNTeams * kNRewardTerms;
GIGA_HD void finish_episode(const Parameters auto& p, World auto& w, int item) {
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
  const int end = p.end_of(item);
  for (int i = p.first_of(item); i < end; ++i)
    if (p.team_of(i) == item) stat(end_of_agent(w.death[i]), item) += 1;
  w.returns[item] = w.returns_masked[item] = w.score[item] = 0;
}

}  // namespace giga
