// TeamController: who moves a team. A learned policy, a script, a population: each kind is one subclass.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/parallel_for.hpp"
#include "math/rows.hpp"
#include "scripted/actions.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"
#include "sim/world_range.hpp"

namespace giga {

/// Buffers of a team at one step; n = agents of the team, D = stride of observation_rows(). Null = not there.
struct TeamBuffers {
  const float* obs = nullptr;        // [W, n, D] what the agents see
  const uint8_t* image = nullptr;    // [W, n, R, R, 3] the same as images, R pixels of a side
  void* action = nullptr;            // [W, n] int32 or [W, n, 3] float
  float* pre_tanh_action = nullptr;  // [W, n, 3] continuous actions before squashing
  float* log_prob = nullptr;         // [W, n] of the actions
  float* memory = nullptr;  // [W, n, S] what the agents remember: S = memory_size(), zeros where an episode begins
  int64_t memory_size = 0;  // S
};

/// One step of a team in some worlds: what its controller sees and writes.
struct TeamStep {
  const Simulator& sim;
  const ParallelFor& parallel_for;  ///< on the simulator's device
  int team;
  int64_t number;  ///< steps since the game started
  WorldRange worlds;
  TeamBuffers buffers;      ///< from the first of the worlds on
  const RowLayout& layout;  ///< of the rows of observations
  /// Whether it follows a step of the same play that lets a kernel begin before it has ended
  /// (Simulator::step_lets_next_begin). What else was queued since writes nothing that a controller keeps.
  bool behind_step = false;

  int n() const { return sim.params().n_team[team]; }
  int64_t n_rows() const { return worlds.count * n(); }
  int obs_stride() const { return layout.stride(); }
  /// The same in worlds that are among these. Where draws have a period, they begin with a whole number of periods, or
  /// lie within one.
  TeamStep part(const WorldRange& some) const;
  /// The same for a controller from whose actions nobody learns.
  TeamStep without_log_prob() const;
  /// Addresses the draws of the agents, which do not depend on who moves the other worlds.
  RowDraws draws() const;
};
/// The same parts, those as one of which one follows the other in the worlds of a team.
std::vector<TeamStep> joined(std::span<const TeamStep> parts);

class TeamController {
 public:
  virtual ~TeamController() = default;

  /// What it reads of its agents' observations. Asked at each start of a game: no more than this is written for it.
  virtual ObservationSet reads() const = 0;
  /// The same of a team, world by world: `sets` gets ObservationSet::bits of each world of a part that it moves, the
  /// first of which is `first`.
  virtual void reads_by_world(int /*team*/, int64_t /*first*/, std::span<uint8_t> sets) const {
    std::fill(sets.begin(), sets.end(), reads().bits());
  }
  /// Whether it fills `pre_tanh_action` and `log_prob`, from which somebody learns.
  virtual bool fills_log_prob() const { return false; }
  /// Numbers that an agent remembers from step to step; 0 = none. Controllers of one side that have any agree on it.
  virtual int64_t memory_size() const { return 0; }
  /// How many share its worlds, of which it gives each a part (part_of), in their order, in each part of a game.
  virtual int64_t n_sharing() const { return 1; }
  /// Whether `act` queues nothing but kernels on the stream of its parts' `parallel_for`, and the same at each step of
  /// a game, as far as its buffers and `number` modulo kListPeriod are the same: then steps of a GPU are recorded, and
  /// the host is not asked at each. By then its first kListPeriod steps have allocated all that it needs.
  virtual bool repeats() const { return false; }
  /// The same where a collector keeps the log-probabilities of its actions: then a controller may act in another way.
  virtual bool repeats_where_kept() const { return repeats(); }
  /// Queues the actions of a step in all parts of the game that it moves, team by team in the order of their worlds.
  virtual void act(std::span<const TeamStep> parts) = 0;
  /// What `act` queues may fall into shares, none of which waits for another: recorded steps have them side by side.
  virtual int n_shares() const { return 1; }
  virtual void act_share(int /*share*/, std::span<const TeamStep> parts) { act(parts); }
};

/// A scripted team.
std::unique_ptr<TeamController> script_controller(Scripted script);
/// The actions of a script for a part of a team.
ScriptedActions scripted_actions(Scripted script, const TeamStep& step);

}  // namespace giga
