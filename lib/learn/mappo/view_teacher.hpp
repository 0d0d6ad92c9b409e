// ViewTeacher: an auxiliary loss that teaches an actor's encoder of images what the egocentric view tells in numbers.
// Rewards alone teach an encoder slowly where it is and who flies where; games know it, and training may look. What it
// learns by serves no policy: it is not played, rated or exported. After Lample and Chaplot 2017, arXiv 1609.05521,
// section 3.2, whose agents are taught in the same way what the picture of a game shows.
#pragma once

#include <ATen/core/Tensor.h>

#include <string>

#include "learn/run_config.hpp"
#include "policy/actor.hpp"
#include "policy/layers.hpp"
#include "policy/optimizer.hpp"

namespace giga {

class ViewTeacher {
 public:
  /// For the actor of `team`, whose observations have the egocentric view among their numbers.
  ViewTeacher(const LoadedRun& run, int team, const Actor& actor, at::Device device);

  /// What the actor's features [R, F] tell of the view: [R, V] fp32, by one linear layer.
  at::Tensor told(const at::Tensor& features) const;
  /// The gradient of the loss by `told`, and the loss: mappo.view_coef times the mean over living rows and the V
  /// numbers of the squared error. obs [R, D] rows of all numbers; alive [R] 0 or 1; inv_count [1] 1 / living rows of
  /// all ranks.
  struct Loss {
    at::Tensor gradient;  // [R, V]
    at::Tensor sum;       // [] over living rows, before mappo.view_coef
  };
  Loss loss(const at::Tensor& told, const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& inv_count) const;

  const ParameterSet& parameters() const { return parameters_; }
  Adam& adam() { return adam_; }
  ObservationSet reads() const { return view_.set; }

  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  float coef_;
  InputColumns view_;  // [V] of the rows
  bool bfloat16_;
  ParameterSet parameters_;
  DenseLayer layer_;
  Adam adam_;
};

}  // namespace giga
