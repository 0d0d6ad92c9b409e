// PopulationGames: the episodes of a generation. Every member of a population plays the same number of them, in worlds
// of its own against opponents that depend on the world only. All worlds step together; one whose episode is over plays
// its next, and is left alone after the last.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "game/game.hpp"
#include "rollout/population_controller.hpp"

namespace giga {

struct PopulationGamesOptions {
  int64_t n_members = 512, n_worlds = 16;  ///< n_worlds: of a member
  int n_populations = 2;                   ///< that play at the same time
  bool common_random_numbers = true;       ///< episode k of world e is the same luck for all members
  bool greedy = true;                      ///< the most likely action instead of a drawn one
  uint64_t seed = 0;
  int n_threads = 0;
  std::optional<int> max_steps = std::nullopt;  ///< episodes are cut off after these, or by the scenario
  int n_rounds = 1;                             ///< episodes that each world plays, one after the other
  int64_t first_world = 0;  ///< without common_random_numbers: global number of world 0, where ranks share a population
  CompileStep compile_step = CompileStep::never;
  Pairs pairs = Pairs::automatic;
  /// Of one population: what moves the other team everywhere; null: whoever its Population names.
  std::shared_ptr<TeamController> opponent = nullptr;
  int opponent_team = 1;
};

class PopulationGames {
 public:
  /// `network` tells the shape of all networks and their arithmetic (see population_controller). It and `parallel_for`
  /// must outlive this. Scenarios without a time limit are cut off after kEpisodeLimit steps (sim/params.hpp).
  PopulationGames(const SimSpec& spec, const PopulationGamesOptions& options, const Actor& network,
                  const ParallelFor& parallel_for);

  /// Lets an observer see the games of each play.
  void watch(GameObserver& observer) { game_->watch(observer); }

  /// Queues all steps of all episodes of n_populations, as Game::play does. Draws are those of steps `first_step` to
  /// `first_step` + draw_steps() - 1.
  void play(const std::vector<Population>& populations, uint32_t first_step);
  /// Steps by which draws are addressed: each episode has its own: one for each step, and two more (sim/step.hpp).
  uint32_t draw_steps() const;

  /// What the episodes of population k came to: [M, E, kNStatRows], a view that the next play overwrites; sums over the
  /// n_rounds episodes of a world.
  at::Tensor results(size_t k) const;

  const Simulator& simulator() const { return *sim_; }
  /// Waits for what was queued. Throws what a simulator tells only then (Simulator::synchronize).
  void synchronize() { sim_->synchronize(); }
  const std::string& refusal() const { return game_->refusal(); }
  /// Whether the fused kernel is used.
  bool fused() const { return fused_; }

 private:
  const PopulationGamesOptions options_;
  const PopulationShape shape_;
  const bool fused_;
  std::unique_ptr<Simulator> sim_;
  std::shared_ptr<PopulationController> controller_;  // of the teams that no other one moves
  std::unique_ptr<Game> game_;
};

}  // namespace giga
