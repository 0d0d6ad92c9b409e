// WorldView: one world as the stages see it: its state, and scratch that lives for one step.
#pragma once

#include "sim/observation.hpp"
#include "sim/state.hpp"

namespace giga {

/// What others are told of an agent, in the units and the order of the vector observation (Feature).
struct alignas(16) AgentFeatures {
  float x, y, z, heading, speed, health, sprite;
};

/// Pointers to one world's arrays, N agents: its state (state.hpp), some of it perhaps in a working copy, and scratch.
struct WorldView : StateView {
  float *dir_x, *dir_y;      // [N] cosine and sine of the heading
  float* taken;              // [N] damage units that the agent took in this step
  float* reward;             // [N] of this step
  float* next;               // [3, N] start coordinates of a round of resampling; in a step, x and y before it
  uint8_t* was_alive;        // [N] before the step
  uint8_t* flags;            // [N] bits of AgentFlag
  uint32_t* hears;           // [N, words] bit b of row e: e hears b
  uint16_t* neighbors;       // [N, n_neighbors] agents of the observation's rows; kNobody = row of zeros
  float* neighbor_distance;  // [N, n_neighbors] while they are ranked
  AgentFeatures* features;   // [N] see vector_observation.hpp
  float* stage;              // [N, kStageColumns] or [kStageRows, kStageRow] part of the rows, on its way to memory
  uint16_t* nearest_agents;  // [N, kNearestAgents] see egocentric_view.hpp
  float* terms;              // [kNRewardTerms, N] what each reward term added to the agent's reward, by its own factor
  int32_t* counts;           // [kNCounts] see Count
};

/// What the stages of a step work on: WorldView, or a type with the same members, whose arrays may be anything that
/// takes an index: an agent's own numbers may be in registers.
template <class W>
concept World = requires(W& w) {
  w.x[0];
  w.alive[0];
  w.neighbors[0];
};

constexpr uint16_t kNobody = 0xFFFF;
constexpr int kNeighborFeatures = 9;  ///< numbers per agent in an observation
constexpr int kWaypointFeatures = 5;  ///< numbers about the waypoint, behind those
constexpr int kStageAgents = 4;       ///< so many agents of each row are staged at a time: 36 numbers, 9 times 16 bytes
constexpr int kStageColumns = kStageAgents * kNeighborFeatures;
/// With constant teams whole rows are staged: so many numbers each, with room for four boxes, as RowLayout has them;
/// half of a world's at a time, of a large one 5 or 10 of them, so that enough worlds have room.
constexpr int stage_row(int n_neighbors, bool waypoints) {
  return (n_neighbors * kNeighborFeatures + (waypoints ? kWaypointFeatures : 0) + 16 + 7) / 8 * 8;
}
constexpr int stage_rows(int n_agents) { return n_agents <= 10 ? n_agents / 2 : n_agents <= 25 ? 5 : 10; }
template <class P>
constexpr int kStageRow = stage_row(P::n_neighbors, P::waypoints);
template <class P>
constexpr int kStageRows = stage_rows(P::kAgents);
constexpr int kNearestAgents = 5;  ///< agents that an egocentric view tells of

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

/// Numbers of the stage of a world of p.
template <Parameters P>
GIGA_HD size_t staged_numbers(const P& p) {
  if constexpr (P::kTeam > 0)
    return static_cast<size_t>(kStageRows<P> * kStageRow<P>);
  else
    return static_cast<size_t>(p.n_agents) * kStageColumns;
}

/// Bytes of scratch that a world of p needs, and the carving of a 16-byte aligned block of that size.
struct ScratchLayout {
  size_t features, stage, terms, neighbor_distance, dir_x, dir_y, taken, reward, next, hears, counts, neighbors,
      was_alive, flags, nearest_agents, size;

  GIGA_HD explicit ScratchLayout(const Parameters auto& p) : ScratchLayout(p, staged_numbers(p)) {}
  /// `staged`: numbers of the stage.
  GIGA_HD ScratchLayout(const Parameters auto& p, size_t staged) {
    const size_t n = static_cast<size_t>(p.n_agents);
    size_t at = 0;
    const auto take = [&at](size_t bytes) {
      const size_t start = at;
      at += (bytes + 3) & ~size_t{3};
      return start;
    };
    features = take(sizeof(AgentFeatures) * n);
    // Rows are staged when nothing else of these is needed any more.
    // Of rewards and distances each is done with before the other.
    const size_t rows = static_cast<size_t>(p.n_neighbors);
    stage = terms = neighbor_distance = take(4 * n * (rows > kNRewardTerms ? rows : kNRewardTerms));
    taken = take(4 * n);
    reward = take(4 * n);
    next = take(4 * n * 3);
    hears = take(4 * n * static_cast<size_t>(words_for(p.n_agents)));
    if (at < stage + 4 * staged) at = stage + 4 * staged;
    dir_x = take(4 * n);
    dir_y = take(4 * n);
    counts = take(4 * kNCounts);
    neighbors = take(2 * n * static_cast<size_t>(p.n_neighbors));
    was_alive = take(n);
    flags = take(n);
    nearest_agents = take(p.egocentric_view ? 2 * n * kNearestAgents : 0);
    size = (at + 15) & ~size_t{15};
  }
};

GIGA_HD void attach_scratch(WorldView& w, const ScratchLayout& layout, char* block) {
  w.dir_x = reinterpret_cast<float*>(block + layout.dir_x);
  w.dir_y = reinterpret_cast<float*>(block + layout.dir_y);
  w.taken = reinterpret_cast<float*>(block + layout.taken);
  w.reward = reinterpret_cast<float*>(block + layout.reward);
  w.next = reinterpret_cast<float*>(block + layout.next);
  w.features = reinterpret_cast<AgentFeatures*>(block + layout.features);
  w.stage = reinterpret_cast<float*>(block + layout.stage);
  w.terms = reinterpret_cast<float*>(block + layout.terms);
  w.neighbor_distance = reinterpret_cast<float*>(block + layout.neighbor_distance);
  w.hears = reinterpret_cast<uint32_t*>(block + layout.hears);
  w.counts = reinterpret_cast<int32_t*>(block + layout.counts);
  w.neighbors = reinterpret_cast<uint16_t*>(block + layout.neighbors);
  w.nearest_agents = reinterpret_cast<uint16_t*>(block + layout.nearest_agents);
  w.was_alive = reinterpret_cast<uint8_t*>(block + layout.was_alive);
  w.flags = reinterpret_cast<uint8_t*>(block + layout.flags);
}

/// The view of world number `world`; scratch is attached separately.
GIGA_HD WorldView world_view(const StateView& all, int n_agents, int64_t world) {
  WorldView w{};
  for_each_field([&](auto field, auto member) { w.*member = all.*member + world * field.count(n_agents); });
  return w;
}

/// Rows of one observation (sim/observations.hpp), of a team's agents [W, n] or of the worlds [W]. Null = not wanted.
/// `final_rows` are copies of `rows` (which must be wanted too) from before a reset, and are written only where an
/// episode ended in this step.
struct ObservationIo {
  void* rows = nullptr;
  void* final_rows = nullptr;
  int stride = 0;  // numbers from one row to the next, of both; 0 = the observation's size. The rest is not touched
  int room = 0;    // but for zeros, which may be written once more: so many numbers from the row's first on
};
struct ObservationIos {
  ObservationIo kinds[kNObservations];
  GIGA_HD ObservationIo& operator[](Observation kind) { return kinds[static_cast<int>(kind)]; }
  GIGA_HD const ObservationIo& operator[](Observation kind) const { return kinds[static_cast<int>(kind)]; }
};

/// What a step reads and writes besides the state: one team's buffers, n = agents of the team. Null = not wanted.
struct TeamIo {
  const void* action = nullptr;    // [W, n] int32 (discrete) or [W, n, 3] float (continuous)
  float* reward = nullptr;         // [W, n]
  uint8_t* alive = nullptr;        // [W, n] when observed: after the reset where the episode ended
  uint8_t* final_alive = nullptr;  // [W, n] as final_rows
  ObservationIos obs;              // of the agents
  const uint8_t* reads = nullptr;  // [W] ObservationSet::bits of those that are read there; null: all that have rows
  /// [W] 1 where the team's egocentric views are those of the game in a mirror, y from the other side, and its turns
  /// are meant so: as if left and right were exchanged. Null: nowhere.
  const uint8_t* mirrored = nullptr;

  GIGA_HD bool reads_in(int64_t world, Observation kind) const {
    return !reads || (reads[world] >> static_cast<int>(kind) & 1) != 0;
  }
  /// What the left of that world's agents is multiplied by: -1 in the mirror, else 1.
  GIGA_HD float mirror(int64_t world) const { return mirrored && mirrored[world] != 0 ? -1.0f : 1.0f; }
};
struct StepIo {
  TeamIo team[kNTeams];
  /// That of a team: a choice, because the GPU reads an array of its arguments by a computed index slowly.
  GIGA_HD const TeamIo& of(int which) const { return which == 0 ? team[0] : team[1]; }
  ObservationIos world;                    // of the worlds
  bool final_of_truncations_only = false;  // leave final_* alone where a game was decided: values need no more of it
  uint8_t* done = nullptr;                 // [W] Done
  float* terms = nullptr;  // [W, kNRewardTerms, N] what each term added, in the original's units (tests)
};

/// What happens to a world whose episode has ended.
enum class OnDone : uint8_t {
  reset,   ///< a new episode starts in the same step
  freeze,  ///< it waits (Phase::waits) and takes no further steps
  keep,    ///< it steps on, as the original does
};

}  // namespace giga
