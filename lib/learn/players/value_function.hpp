// ValueFunction: the critic of a team, to look at games with. Nothing is learned here.
#pragma once

#include <ATen/core/Tensor.h>

#include <memory>
#include <optional>

#include "core/named_array.hpp"
#include "core/parallel_for.hpp"
#include "learn/run_config.hpp"
#include "policy/critic.hpp"
#include "policy/normalizer.hpp"

namespace giga {

class Actor;

class ValueFunction {
 public:
  /// The critic of a team among the arrays of a checkpoint; null where there is none. `actor`, whose normaliser or
  /// encoder the observations pass, must outlive it.
  static std::unique_ptr<ValueFunction> load(const LoadedRun& run, int team, const NamedArrays& arrays,
                                             const Actor& actor, Device device);

  /// obs [W, n, D] (images where it reads them), alive [W, n] bytes, state [W, G] (undefined unless needed) -> returns
  /// that are expected [W, n]. `memory` [W n, S]: read, and replaced by what the critic remembers now.
  at::Tensor forward(const at::Tensor& obs, const at::Tensor& alive, const at::Tensor& state,
                     NetworkState& memory) const;

  /// Numbers that it remembers of a row; 0 = no memory.
  int64_t state_size() const { return critic_.state_size(); }
  bool needs_state() const { return critic_.needs_state(); }
  bool reads_image() const { return critic_.reads_image(); }
  ObservationSet reads() const { return critic_.reads(); }

 private:
  ValueFunction(const LoadedRun& run, int team, const Actor& actor, Device device);

  const Actor& actor_;
  const ParallelFor parallel_for_;
  Critic critic_;
  std::optional<FusedMlp> fused_;  // where the kernel of training serves: LibTorch would load its own for a few rows
  RunningNorm norm_;
};

}  // namespace giga
