// WorldView: one world as the stages see it: its state, and scratch that lives for one step.
#pragma once

#include "sim/state.hpp"

namespace giga {

/// Pointers to one world's arrays, N agents. The fields of the first block may point to a working copy (shared memory
/// on the GPU); what they hold is explained in state.hpp.
struct WorldView {
  float *x, *y, *z, *v, *heading, *health;  // [N]
  uint8_t* alive;                           // [N]
  uint8_t* tracked;                         // [N, N] [target, shooter]
  uint32_t *detected, *seen;                // [N, words]
  Death* death;                             // [N]
  int32_t* map;
  float* waypoint;  // [4]
  float *waypoint_time, *reward_factor;
  int32_t* episode_length;
  uint32_t* draw_step;
  Outcome* outcome;
  Phase* phase;
  float *returns, *returns_masked, *score;  // [2]
  float* term_returns;                      // [2, kNRewardTerms]
  float* stats;                             // [kNStatRows]

  // Scratch.
  float *dir_x, *dir_y;  // [N] cosine and sine of the heading
  float* taken;          // [N] damage units that the agent took in this step
  float* reward;         // [N] of this step
  float* next;           // [3, N] start coordinates of a round of resampling; in a step, x and y before it
  uint8_t* was_alive;    // [N] before the step
  uint8_t* flags;        // [N] bits of AgentFlag
  uint32_t* talk;        // [N, words] bit b of row e: e hears b
  uint16_t* neighbors;   // [N, n_neighbors] agents of the observation's rows; kNobody = row of zeros
  float* neighbor_keys;  // [N, n_neighbors] their distances, then their headings relative to the agent's
  float* features;       // [N, kNeighborFeatures] of observations, see observe.hpp
  uint16_t* company;     // [N, kBodyCompany] agents of the body view, see body_view.hpp
  float* terms;          // [kNRewardTerms, N] what each reward term added to the agent's reward
  int32_t* counts;       // [kNCounts] see Count
};

constexpr uint16_t kNobody = 0xFFFF;
constexpr int kNeighborFeatures = 9;  ///< numbers per agent in an observation
constexpr int kBodyCompany = 5;       ///< agents that a body view tells of

/// What happened to an agent in this step.
enum AgentFlag : uint8_t {
  kHitWaypoint = 1,
  kOutOfBounds = 2,
  kHitAgent = 4,
  kHitObstacle = 8,
  kTookDamage = 16,
  kNeedsResample = 32,
};

/// Per-world counters of a step.
enum Count : int { kAlive0, kAlive1, kWasAlive0, kWasAlive1, kDone, kNCounts };

/// How an episode stands after a step.
enum class Done : uint8_t {
  running,
  terminated,  ///< the game is decided: values beyond it are zero
  truncated,   ///< the time limit: the game would have gone on, so bootstrap from the final observation
};

/// Bytes of scratch that a world of p needs, and the carving of a 16-byte aligned block of that size.
struct ScratchLayout {
  size_t dir_x, dir_y, taken, reward, next, features, terms, neighbor_keys, talk, counts, neighbors, company, was_alive,
      flags, size;

  GIGA_HD explicit ScratchLayout(const SimParams& p) {
    const size_t n = static_cast<size_t>(p.n_agents);
    size_t at = 0;
    const auto take = [&at](size_t bytes) {
      const size_t start = at;
      at += (bytes + 3) & ~size_t{3};
      return start;
    };
    dir_x = take(4 * n);
    dir_y = take(4 * n);
    taken = take(4 * n);
    reward = take(4 * n);
    next = take(4 * n * 3);
    features = take(4 * n * kNeighborFeatures);
    terms = take(4 * n * kNRewardTerms);
    neighbor_keys = take(4 * n * static_cast<size_t>(p.n_neighbors));
    talk = take(4 * n * static_cast<size_t>(words_for(p.n_agents)));
    counts = take(4 * kNCounts);
    neighbors = take(2 * n * static_cast<size_t>(p.n_neighbors));
    company = take(p.body_view ? 2 * n * kBodyCompany : 0);
    was_alive = take(n);
    flags = take(n);
    size = (at + 15) & ~size_t{15};
  }
};

GIGA_HD void attach_scratch(WorldView& w, const ScratchLayout& layout, char* block) {
  w.dir_x = reinterpret_cast<float*>(block + layout.dir_x);
  w.dir_y = reinterpret_cast<float*>(block + layout.dir_y);
  w.taken = reinterpret_cast<float*>(block + layout.taken);
  w.reward = reinterpret_cast<float*>(block + layout.reward);
  w.next = reinterpret_cast<float*>(block + layout.next);
  w.features = reinterpret_cast<float*>(block + layout.features);
  w.terms = reinterpret_cast<float*>(block + layout.terms);
  w.neighbor_keys = reinterpret_cast<float*>(block + layout.neighbor_keys);
  w.talk = reinterpret_cast<uint32_t*>(block + layout.talk);
  w.counts = reinterpret_cast<int32_t*>(block + layout.counts);
  w.neighbors = reinterpret_cast<uint16_t*>(block + layout.neighbors);
  w.company = reinterpret_cast<uint16_t*>(block + layout.company);
  w.was_alive = reinterpret_cast<uint8_t*>(block + layout.was_alive);
  w.flags = reinterpret_cast<uint8_t*>(block + layout.flags);
}

/// The view of world number `world`; scratch is attached separately.
GIGA_HD WorldView world_view(const StateView& s, const SimParams& p, int64_t world) {
  const int64_t n = p.n_agents, words = words_for(p.n_agents);
  const int64_t a = world * n, b = a * words;
  WorldView w{};
  w.x = s.x + a;
  w.y = s.y + a;
  w.z = s.z + a;
  w.v = s.v + a;
  w.heading = s.heading + a;
  w.health = s.health + a;
  w.alive = s.alive + a;
  w.tracked = s.tracked + a * n;
  w.detected = s.detected + b;
  w.seen = s.seen + b;
  w.death = s.death + a;
  w.map = s.map + world;
  w.waypoint = s.waypoint + world * 4;
  w.waypoint_time = s.waypoint_time + world;
  w.reward_factor = s.reward_factor + world;
  w.episode_length = s.episode_length + world;
  w.draw_step = s.draw_step + world;
  w.outcome = s.outcome + world;
  w.phase = s.phase + world;
  w.returns = s.returns + world * kNTeams;
  w.returns_masked = s.returns_masked + world * kNTeams;
  w.score = s.score + world * kNTeams;
  w.term_returns = s.term_returns + world * kNTeams * kNRewardTerms;
  w.stats = s.stats + world * kNStatRows;
  return w;
}

/// What a step reads and writes besides the state: one team's buffers, n = agents of the team, D = observation size.
/// Null = not wanted. `final_*` are copies of obs, alive and global (which must be wanted too) from before a reset, and
/// are written only where an episode ended in this step.
struct TeamIo {
  const void* action = nullptr;    // [W, n] int32 (discrete) or [W, n, 3] float (continuous)
  float* obs = nullptr;            // [W, n, D] after the step (after the reset where the episode ended)
  float* reward = nullptr;         // [W, n]
  uint8_t* alive = nullptr;        // [W, n] at `obs`
  float* final_obs = nullptr;      // [W, n, D]
  uint8_t* final_alive = nullptr;  // [W, n]
};
struct StepIo {
  TeamIo team[kNTeams];
  int obs_stride = 0;      // from one row of obs and final_obs to the next; 0 = D. The rest is not touched
  bool body_only = false;  // of obs write the body view alone (SimParams::body_view), for whom nobody reads the rest
  bool final_of_truncations_only = false;  // leave final_* alone where a game was decided: values need no more of it
  uint8_t* done = nullptr;                 // [W] Done
  float* global = nullptr;                 // [W, G] true state, see state_encoding.hpp
  float* final_global = nullptr;           // [W, G]
  float* terms = nullptr;  // [W, kNRewardTerms, N] what each term added, in the original's units (tests)
};

/// What happens to a world whose episode has ended.
enum class OnDone : uint8_t {
  reset,   ///< a new episode starts in the same step
  freeze,  ///< it waits (Phase::waits) and takes no further steps
  keep,    ///< it steps on, as the original does
};

}  // namespace giga
