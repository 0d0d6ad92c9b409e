// PopulationGames: the episodes of a generation. Every member of a population plays the same number of them, in worlds
// of its own against opponents that depend on the world only. All worlds step together; one whose episode is over plays
// its next, and is left alone after the last.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "cuda/population_policy.hpp"
#include "cuda/rows.hpp"
#include "policy/actor.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// One team's population and whom it meets. M = members, P = parameters of a network, E = worlds of a member.
struct Population {
  int team = 0;
  at::Tensor members;             // [M, P]
  at::Tensor opponents;           // [K, P] networks of the other team
  std::vector<int32_t> opponent;  // [E] row of `opponents`, or a script (network_of_script)
};

struct PopulationGamesOptions {
  int64_t n_members = 512, n_worlds = 16;  ///< n_worlds: of a member
  int n_populations = 2;                   ///< that play at the same time
  bool common_random_numbers = true;       ///< episode k of world e is the same luck for all members
  bool greedy = true;                      ///< the most likely action instead of a drawn one
  uint64_t seed = 0;
  int n_threads = 0;
  std::optional<int> max_steps = std::nullopt;  ///< episodes are cut off after these, or by the scenario
  int n_rounds = 1;                             ///< episodes that each world plays, one after the other
};

class PopulationGames {
 public:
  /// `network` tells the shape of all networks and their arithmetic: on a GPU those in fp16 are computed by the fused
  /// kernel, which must have room for them, all others by LibTorch. It and `rows` must outlive this. Scenarios without
  /// a time limit are cut off after kEpisodeLimit steps (sim/simulator.hpp).
  PopulationGames(const SimSpec& spec, const PopulationGamesOptions& options, const Actor& network,
                  const RowRunner& rows);

  /// Queues all steps of all episodes, n_populations of them at most. Fresh draws for each `generation`. On a GPU the
  /// host does not wait.
  void play(const std::vector<Population>& populations, uint32_t generation);

  /// What the episodes of population k came to: [M, E, kNStatRows], a view that the next play overwrites; sums over the
  /// n_rounds episodes of a world.
  at::Tensor results(size_t k) const;

  const Simulator& simulator() const { return *sim_; }
  /// Whether the fused kernel is used.
  bool fused() const { return fused_.has_value(); }

 private:
  struct Side {
    at::Tensor obs;     // [W, n, D]
    at::Tensor action;  // [W, n] int32 or [W, n, 3]
  };
  int64_t n_worlds_each() const { return options_.n_members * options_.n_worlds; }
  PopulationAct act(int team, int64_t first_world) const;
  at::Tensor packed(const at::Tensor& networks) const;
  PopulationPolicy fused_policy(const std::vector<Population>& populations) const;
  PopulationScripts scripts_of(const Population& population, size_t k) const;
  void move_scripts(const std::vector<Population>& populations) const;
  void move_members(const Population& population, size_t k) const;
  void move_opponents(const Population& population, size_t k) const;
  void group_opponents(const Population& population, size_t k);
  const int32_t* opponents_of(size_t k) const;
  void run_actions(int team, size_t k, const at::Tensor& head, const at::Tensor& networks,
                   const int32_t* network) const;

  const PopulationGamesOptions options_;
  const Actor& network_;
  const RowRunner& rows_;
  std::unique_ptr<Simulator> sim_;
  std::optional<PackedMlp> fused_;  // layout of networks for the fused kernel; none = through LibTorch
  Side side_[kNTeams];
  StepIo io_;
  at::Tensor opponent_;             // [n_populations, E] int32
  at::Tensor work_;                 // [pieces + 1] int32: see PopulationPolicy; fused only
  std::vector<at::Tensor> packed_;  // [networks, PackedMlp::size] members and opponents in turn; fused only
  struct OpponentGroup {
    int64_t network;    // row of the opponents
    at::Tensor worlds;  // of each member in which it plays, int64
  };
  std::vector<std::vector<OpponentGroup>> groups_;  // by population; not fused only
};

}  // namespace giga
