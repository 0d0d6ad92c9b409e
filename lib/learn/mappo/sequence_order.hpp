// SequenceOrder: in which order a team learns from the sequences of a rollout in an epoch.
#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>

#include "core/memory.hpp"

namespace giga {

/// Each minibatch takes as many sequences of every shard, a part of the worlds, whose order goes by its number among
/// all ranks: so it does not depend on which rank has the shard.
struct SequenceOrder {
  int64_t n_sequences;  // of this rank
  int64_t n_minibatches;
  int64_t n_worlds;                   // in which the team learns, of this rank
  int64_t n_shards;                   // of all ranks; 1: the sequences have one order
  int64_t first_shard, n_own_shards;  // of this rank

  /// A random order [n_sequences] of 0 to n_sequences - 1, the same for the same seed. With several shards without the
  /// last few of each, where n_minibatches does not divide their number.
  at::Tensor draw(uint64_t seed, Device device) const;
};

}  // namespace giga
