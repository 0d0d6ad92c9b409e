// EvolutionStrategy: a search distribution over the parameters of a team's policy, by ask and tell.
#pragma once

#include <torch/types.h>

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/named_array.hpp"
#include "core/parallel_for.hpp"
#include "learn/evolution/config.hpp"
#include "math/es_noise.hpp"
#include "policy/parameters.hpp"

namespace giga {

/// The ranks that share populations (lib/ranks): each perturbs its own members, and adds up over all of them for its
/// own part of the parameters. Noise is made from counters, so of all this only sums and fitness cross.
struct PopulationShare {
  int rank = 0, size = 1;
  /// The tensors [n] of all ranks, those of rank 0 first: [size n], on the device of `mine`. All call it in one order.
  std::function<at::Tensor(const at::Tensor& mine)> gather = {};
};

/// Whose population it is, and where its noise comes from.
struct PopulationPlace {
  uint64_t seed = 0;
  int team = 0;
  std::vector<MatrixPlace> matrices;  ///< noise low_rank is for these; other parameters have full noise
  PopulationShare share = {};
};

class EvolutionStrategy {
 public:
  virtual ~EvolutionStrategy() = default;

  /// Parameters of this generation's members [M, P]; of several ranks, those of this one.
  at::Tensor ask();
  /// Learns from the fitness [M] of all members, larger is better, and goes on to the next generation. Computes the
  /// noise of `ask` again; queues work on the device and does not wait. Returns a bool [] on the device: false where a
  /// number of the new state was not finite; then the step is undone, and only the generation goes on.
  at::Tensor tell(const at::Tensor& fitness);

  const at::Tensor& mean() const { return mean_; }    // [P]
  const at::Tensor& sigma() const { return sigma_; }  // [P]
  int64_t population_size() const { return config_.population_size; }
  uint32_t generation() const { return generation_; }

  /// Of several ranks: those whose sums of the latest `tell` were not finite; waits for the device.
  std::vector<int> faulty_ranks() const;

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 protected:
  EvolutionStrategy(const PopulationConfig& config, const PopulationPlace& place, const at::Tensor& mean,
                    const ParallelFor& parallel_for);

  /// Sums over the members of weight x noise and weight x noise^2, [P] each.
  struct Moments {
    at::Tensor first, second;
  };
  Moments moments(const at::Tensor& weights);
  /// Changes the state by the shaped fitness [M], in which every number is finite.
  virtual void learn(const at::Tensor& shaped) = 0;

  struct StateTensor {
    const char* name;  // in a checkpoint
    at::Tensor tensor;
  };
  /// Everything that `learn` changes: it is saved, loaded, and restored where a step is undone.
  virtual std::vector<StateTensor> state() const { return {{"mean", mean_}, {"sigma", sigma_}}; }

  at::Tensor mean_, sigma_;
  uint32_t generation_ = 0;

 private:
  EsNoise noise() const;
  at::Tensor of_all_ranks(const at::Tensor& mine) const { return share_.size > 1 ? share_.gather(mine) : mine; }

  const PopulationConfig config_;
  const uint64_t seed_;
  const int team_;
  const PopulationShare share_;
  const ParallelFor& parallel_for_;
  at::Tensor left_, right_;  // [P] int32, see EsNoise; noise low_rank only
  at::Tensor sums_;          // [ranks, 2, parameters of each] the latest; undefined with one rank
  at::Tensor mean_squares_;  // [M] of the members that were asked for last; weight decay of the shaping only
};

/// `mean` [P]: where the search starts; it is copied. `parallel_for` must outlive the strategy.
using MakeStrategy = std::function<std::unique_ptr<EvolutionStrategy>(
    const RunConfig&, const PopulationPlace&, const at::Tensor& mean, const ParallelFor& parallel_for)>;
std::unique_ptr<EvolutionStrategy> make_openai_es(const PopulationConfig& population, const OpenAiEsConfig& config,
                                                  const PopulationPlace& place, const at::Tensor& mean,
                                                  const ParallelFor& parallel_for);
std::unique_ptr<EvolutionStrategy> make_snes(const PopulationConfig& population, const SnesConfig& config,
                                             const PopulationPlace& place, const at::Tensor& mean,
                                             const ParallelFor& parallel_for);
std::unique_ptr<EvolutionStrategy> make_des(const PopulationConfig& population, const DesConfig& config,
                                            const PopulationPlace& place, const at::Tensor& mean,
                                            const ParallelFor& parallel_for);

}  // namespace giga
