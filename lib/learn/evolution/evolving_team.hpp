// EvolvingTeam: the policy of one team, its search distribution, and the pool of its past means.
#pragma once

#include <torch/types.h>

#include <memory>
#include <string>
#include <vector>

#include "core/parallel_for.hpp"
#include "learn/evolution/strategy.hpp"
#include "learn/opponents/pool.hpp"
#include "policy/actor.hpp"

namespace giga {

/// Figures of a generation, kept on the device until they are read.
enum EvolutionFigure : int {
  kFigFitnessMean,  // over the finite ones
  kFigFitnessBest,
  kFigFitnessDeviation,
  kFigNotFinite,      // members whose fitness is not finite
  kFigSigma,          // mean over the parameters
  kFigParameterNorm,  // of the mean
  kFigStepNorm,       // of its last step
  kFigDiverged,       // 1: the new mean or sigma was not finite, and the old ones were kept
  kNEvolutionFigures
};

class EvolvingTeam {
 public:
  EvolvingTeam(const LoadedRun& run, int team, Device device, const MakeStrategy& make_strategy,
               const ParallelFor& parallel_for, const PopulationShare& share = {});

  at::Tensor ask() { return strategy_->ask(); }
  /// Learns from the fitness [M] of the members of this generation, of all ranks; the actor becomes the new mean.
  void tell(const at::Tensor& fitness);

  /// Of several ranks: those whose sums of the latest `tell` were not finite.
  std::vector<int> faulty_ranks() const { return strategy_->faulty_ranks(); }

  Actor& actor() { return actor_; }
  const Actor& actor() const { return actor_; }
  const OpponentPool& pool() const { return pool_; }
  OpponentPool& pool() { return pool_; }
  const at::Tensor& figures() const { return figures_; }  // [kNEvolutionFigures]
  const at::Tensor& fitness() const { return fitness_; }  // [M] of the last tell

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  void show_mean();

  Actor actor_;  // its parameters are the mean
  std::unique_ptr<EvolutionStrategy> strategy_;
  OpponentPool pool_;  // of means
  at::Tensor figures_, fitness_;
};

}  // namespace giga
