// State of all worlds: a member and its line in the field list below declare a field everywhere.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/host_device.hpp"
#include "sim/params.hpp"

namespace giga {

/// Columns of the statistics of finished episodes, summed per world until they are read.
enum class EpisodeStat : int {
  episodes,
  length,  ///< steps
  wins_0,  ///< episodes that team 0 has won, by SimParams::win
  wins_1,
  ties,
  truncated,  ///< ended by the time limit
  return_0,   ///< sum over the team's agents of all rewards
  return_1,
  return_masked_0,  ///< the original's: without the last step and without the steps in which an agent died
  return_masked_1,
  score_0,  ///< waypoints that the team has collected; one in which both teams are counts for both
  score_1,
  survivors_0,  ///< agents of the team that lived at the end
  survivors_1,
  deaths_damage_0,  ///< by Death; those of a team and its survivors add up to its agents
  deaths_damage_1,
  deaths_agent_0,
  deaths_agent_1,
  deaths_obstacle_0,
  deaths_obstacle_1,
  deaths_bounds_0,
  deaths_bounds_1,
};
constexpr int kNEpisodeStats = 22;
constexpr const char* kEpisodeStatNames[kNEpisodeStats] = {
    "episodes",
    "length",
    "wins_0",
    "wins_1",
    "ties",
    "truncated",
    "return_0",
    "return_1",
    "return_masked_0",
    "return_masked_1",
    "score_0",
    "score_1",
    "survivors_0",
    "survivors_1",
    "deaths_damage_0",
    "deaths_damage_1",
    "deaths_agent_0",
    "deaths_agent_1",
    "deaths_obstacle_0",
    "deaths_obstacle_1",
    "deaths_bounds_0",
    "deaths_bounds_1",
};
/// The statistic of a team, from that of team 0, behind which it stands.
constexpr EpisodeStat of_team(EpisodeStat of_team_0, int team) {
  return static_cast<EpisodeStat>(static_cast<int>(of_team_0) + team);
}
/// Rows of the statistics buffer: EpisodeStat, then the return of each reward term for team 0, then for team 1.
constexpr int kNStatRows = kNEpisodeStats + kNTeams * kNRewardTerms;

/// Who has won the episode of a world: open while it runs and is undecided, decided at its end at the latest.
enum class Outcome : int32_t { open, team_0, team_1, tie };

/// What an agent died of, once an episode at most. Where a step brings several, the one that comes first in the step:
/// an agent that leaves the map cannot collide, one that collides is not checked against obstacles, and only living
/// agents can be shot.
enum class Death : uint8_t {
  none,           ///< it lives
  damage,         ///< shot
  agent,          ///< collided with an agent, of either team
  obstacle,       ///< flew into an obstacle
  out_of_bounds,  ///< left the map
};
constexpr int kNDeaths = 4;  ///< causes, without `none`
constexpr const char* kDeathNames[kNDeaths] = {"damage", "agent", "obstacle", "out_of_bounds"};

/// What a world is about to do.
enum class Phase : uint8_t {
  plays,
  waits,       ///< its episode is over and no new one starts (OnDone::freeze)
  terminated,  ///< its episode ended in this step and is to be settled
  truncated,   ///< likewise, by the time limit
};

/// Pointers to the arrays of W worlds of N agents, or of one world (W = 1). Everything here is saved in a checkpoint.
struct StateView {
  uint32_t* seen;           // [W, N, words] bit a of row e: e sees a in its last observation
  float* x;                 // [W, N] position, map units
  float* y;                 // [W, N]
  float* z;                 // [W, N] altitude
  float* v;                 // [W, N] speed, units a second
  float* heading;           // [W, N] radians
  float* health;            // [W, N]
  uint8_t* alive;           // [W, N] 0 or 1
  Death* death;             // [W, N]
  uint8_t* tracked;         // [W, N, N] steps of unbroken fire, [target, shooter]; stops at 255
  uint32_t* detected;       // [W, N, words] bit b of row a: b detected a in the last step
  int32_t* map;             // [W] index into the maps of the scenario
  float* waypoint;          // [W, 4] x1 y1 x2 y2
  float* waypoint_time;     // [W] remaining seconds; 0 = none
  float* reward_factor;     // [W] the original's aux_rewards_factor: scales all terms but game_won
  int32_t* episode_length;  // [W] steps since the reset
  uint32_t* draw_step;      // [W] steps since the start: the step of the next draw
  Outcome* outcome;         // [W] see outcome_of in episode.hpp
  Phase* phase;             // [W]
  float* returns;           // [W, 2] by team, this episode
  float* returns_masked;    // [W, 2] see EpisodeStat
  float* score;             // [W, 2] waypoints collected, this episode
  float* term_returns;      // [W, 2, kNRewardTerms] by team and term, this episode
  float* stats;             // [W, kNStatRows] of finished episodes since they were last read
};

/// What an array of the state has a row for.
enum class Per : uint8_t { world, agent, pair, agent_words };

/// How large a field is: one row of `columns` numbers for each of what `per` says. `working`: the steps of a world work
/// on a copy near to hand (shared memory on the GPU).
template <Per per_, int columns_ = 1, bool working_ = false>
struct StateField {
  static constexpr Per per = per_;
  static constexpr int columns = columns_;
  static constexpr bool working = working_;
  const char* name;

  /// Elements in one world.
  GIGA_HD static int64_t count(int n_agents) {
    const int64_t n = n_agents;
    const int64_t rows = per == Per::agent ? n : per == Per::pair ? n * n : n * words_for(n_agents);
    return (per == Per::world ? 1 : rows) * columns_;
  }
};
template <Per per>
using WorkingField = StateField<per, 1, true>;

/// The field list: calls f(field, pointer to the member) for every member of StateView, in its order. Allocation,
/// checkpoints, comparison, the view of one world and the working copy all go by it.
template <class F>
GIGA_HD constexpr void for_each_field(F&& f) {
  f(WorkingField<Per::agent_words>{"seen"}, &StateView::seen);
  f(WorkingField<Per::agent>{"x"}, &StateView::x);
  f(WorkingField<Per::agent>{"y"}, &StateView::y);
  f(WorkingField<Per::agent>{"z"}, &StateView::z);
  f(WorkingField<Per::agent>{"v"}, &StateView::v);
  f(WorkingField<Per::agent>{"heading"}, &StateView::heading);
  f(WorkingField<Per::agent>{"health"}, &StateView::health);
  f(WorkingField<Per::agent>{"alive"}, &StateView::alive);
  f(StateField<Per::agent>{"death"}, &StateView::death);
  f(WorkingField<Per::pair>{"tracked"}, &StateView::tracked);
  // Not in front of `seen`, but in a working copy of `tracked` (working_copy): who looks reads it for two or four
  // agents at a time, and where their number is odd a word of what follows too. Nobody writes `tracked` meanwhile.
  f(WorkingField<Per::agent_words>{"detected"}, &StateView::detected);
  f(WorkingField<Per::world>{"map"}, &StateView::map);
  f(StateField<Per::world, 4>{"waypoint"}, &StateView::waypoint);
  f(StateField<Per::world>{"waypoint_time"}, &StateView::waypoint_time);
  f(WorkingField<Per::world>{"reward_factor"}, &StateView::reward_factor);
  f(WorkingField<Per::world>{"episode_length"}, &StateView::episode_length);
  f(WorkingField<Per::world>{"draw_step"}, &StateView::draw_step);
  f(WorkingField<Per::world>{"outcome"}, &StateView::outcome);
  f(WorkingField<Per::world>{"phase"}, &StateView::phase);
  f(StateField<Per::world, kNTeams>{"returns"}, &StateView::returns);
  f(StateField<Per::world, kNTeams>{"returns_masked"}, &StateView::returns_masked);
  f(StateField<Per::world, kNTeams>{"score"}, &StateView::score);
  f(StateField<Per::world, kNTeams * kNRewardTerms>{"term_returns"}, &StateView::term_returns);
  f(StateField<Per::world, kNStatRows>{"stats"}, &StateView::stats);
}

constexpr size_t count_fields() {
  size_t count = 0;
  for_each_field([&count](auto, auto) { ++count; });
  return count;
}
static_assert(sizeof(StateView) == count_fields() * sizeof(void*), "a member of StateView is not in the field list");

}  // namespace giga
