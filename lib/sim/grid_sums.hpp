// Sums over the agents of a team, in a world of many agents (rules 17.5), and how they ended.
#pragma once

#include "sim/episode.hpp"
#include "sim/grid.hpp"
#include "sim/rewards.hpp"

namespace giga {

/// Sums of blocks that half a warp adds up by blocks of these, one after the other, in less time than all take to meet
/// at a barrier; or a lane, while others look for agents.
constexpr int kMostBlocksAtOnce = 8 * kSumBlock;

/// Blocks of kSumBlock agents of a team, or of so many such sums.
GIGA_HD int sum_blocks(int n) { return (n + kSumBlock - 1) / kSumBlock; }
/// All sums of an item over a team of n agents (SharedWork::sums).
GIGA_HD int sums_of_team(int n) {
  int sums = 0;
  for (int count = sum_blocks(n);; count = sum_blocks(count)) {
    sums += count;
    if (count <= kSumBlock) return sums;
  }
}

constexpr int kMaskedRow = 1;

/// Where sums of blocks lie in SharedWork::sums: [items, pitch], of the larger team in both.
struct SumLayout {
  int items, blocks, pitch;

  GIGA_HD explicit SumLayout(const GridParams& p) : items(n_step_items(p)) {
    const int most = p.n_team[0] > p.n_team[1] ? p.n_team[0] : p.n_team[1];
    blocks = sum_blocks(most);
    pitch = sums_of_team(most);
  }
  /// Number of a team's item k: its returns, then its terms.
  GIGA_HD int item(int team, int k) const { return k == 0 ? team : kNTeams + team * (items / kNTeams - 1) + k - 1; }
  /// What a team adds up of each block: its returns, those masked (kMaskedRow), its terms.
  GIGA_HD int rows() const { return items / kNTeams + 1; }
  GIGA_HD int item_of_row(int team, int row) const { return item(team, row < kMaskedRow ? row : row - 1); }
  /// How many of n are in a block.
  GIGA_HD static int left(int n, int block) {
    const int more = n - block * kSumBlock;
    return more < 0 ? 0 : more < kSumBlock ? more : kSumBlock;
  }
};

/// What an item of accumulate_episode adds up: a team's returns, or one of its terms, by its place in term_returns.
struct StepItem {
  int team, term;

  GIGA_HD StepItem(const GridParams& p, int item) {
    const int k = item - kNTeams;
    team = item < kNTeams ? item : (k >= p.n_active_terms ? 1 : 0);
    term = item < kNTeams ? -1 : active_term(p, k - team * p.n_active_terms);
  }
  /// Of agent i, as term_of_step has it: who was dead earns nothing, its reward is 0 anyway. One way for returns and
  /// terms, so that a lane asks for numbers of several items at once. Nobody asks for `masked` of a term.
  GIGA_HD StepSum of(const GridParams& p, const GridWorld& w, int i) const {
    const float* const numbers = term < 0 ? w.reward : w.terms + term * p.n_agents;
    const float number = w.was_alive[i] ? numbers[i] : 0.0f;
    return {number, w.alive[i] ? number : 0.0f};
  }
  GIGA_HD void add_to_episode(const GridParams& p, GridWorld& w, const StepSum& step) const {
    if (term < 0) {
      w.returns[team] += step.sum;
      if (!w.counts[kDone]) w.returns_masked[team] += step.masked;
    } else {
      w.term_returns[team * kNRewardTerms + term] += scale_term(p, w, static_cast<RewardTerm>(term), step.sum);
    }
  }
};

/// Adds up numbers in their order, number(k): of more than kSumBlock the sums of so many each, of at most as many
/// blocks. For a worker alone; some numbers are on their way at a time.
template <class Number>
GIGA_HD StepSum add_up(int count, Number&& number) {
  constexpr int kAtOnce = 16;
  static_assert(kSumBlock % kAtOnce == 0);
  StepSum all;
  GIGA_ROLLED
  for (int front = 0; front < count; front += kSumBlock) {
    const int end = count - front < kSumBlock ? count : front + kSumBlock;
    StepSum sum;
    GIGA_ROLLED
    for (int at = front; at < end; at += kAtOnce) {
      StepSum read[kAtOnce];
      GIGA_UNROLL
      for (int k = 0; k < kAtOnce; ++k)
        if (at + k < end) read[k] = number(at + k);
      GIGA_UNROLL
      for (int k = 0; k < kAtOnce; ++k)
        if (at + k < end) sum += read[k];
    }
    if (front == 0)
      all = sum;
    else
      all += sum;
  }
  return all;
}

/// Rules 17.5, by one worker.
GIGA_HD void accumulate_episode(const GridParameters auto& p, GridWorld& w, int item) {
  constexpr int kLevels = 4;
  static_assert(kMaxGridAgents <= int64_t{kSumBlock} * kSumBlock * kSumBlock * kSumBlock);
  const StepItem what(p, item);
  StepSum level[kLevels] = {};
  const auto close = [&](int at) {
    level[at + 1] += level[at];
    level[at] = {};
  };
  for_team(p, what.team, [&](int i, int slot) {
    level[0] += what.of(p, w, i);
    for (int at = 0, n = slot + 1; at + 1 < kLevels && n % kSumBlock == 0; ++at, n /= kSumBlock) close(at);
  });
  for (int at = 0; at + 1 < kLevels; ++at) close(at);
  what.add_to_episode(p, w, level[kLevels - 1]);
}

/// How the agents of a team ended is counted in whole numbers: one by one, a float counts to 16,777,216 only.
GIGA_HD void finish_episode(const GridParameters auto& p, GridWorld& w, int item) {
  GridParams nobody = p;
  nobody.team_after_team = true;
  nobody.n_team[0] = nobody.n_team[1] = nobody.n_agents = 0;
  finish_episode(nobody, static_cast<WorldView&>(w), item);
  if (item >= kNTeams) return;
  int ends[kNDeaths + 1] = {};
  for (int i = p.first_of(item); i < p.end_of(item); ++i)
    if (p.team_of(i) == item) ++ends[static_cast<int>(w.death[i])];
  for (int death = 0; death <= kNDeaths; ++death)
    w.stats[static_cast<int>(end_of_agent(static_cast<Death>(death))) + item] += static_cast<float>(ends[death]);
}

}  // namespace giga
