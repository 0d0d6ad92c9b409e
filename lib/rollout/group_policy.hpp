// GroupPolicy: several networks of one shape, each for its own group of worlds, evaluated together.
#pragma once

#include <ATen/core/Tensor.h>

#include <cstdint>
#include <optional>

#include "policy/fused_actor.hpp"

namespace giga {

/// G groups of equally many worlds in a row. A network is a row of numbers: the P parameters of an actor; if that
/// normalises its observations, their mean and deviation follow, D numbers each.
class GroupPolicy {
 public:
  /// `network` tells the shape and whether observations are normalised.
  GroupPolicy(const Actor& network, const ActorConfig& config, Precision precision);

  /// The row [row size] of an actor as it is now.
  static at::Tensor row_of(const Actor& actor);

  /// The networks [G, row size] of the groups; they are not copied.
  void set(const at::Tensor& rows) { rows_ = rows; }
  /// obs [R, D] of all groups, R / G each -> [R, head size], as Actor::forward.
  at::Tensor forward(const at::Tensor& obs, NetworkState& state) const;
  /// The networks for the fused kernel, as fused_policy() gives that of an actor.
  std::optional<FusedPolicy> fused() const;

  const at::Tensor& rows() const { return rows_; }
  int64_t groups() const { return rows_.size(0); }
  ObservationSet reads() const { return shape_.reads(); }
  const InputColumns& inputs() const { return shape_.inputs(); }
  ActionKind actions() const { return shape_.actions(); }
  int64_t state_size() const { return shape_.state_size(); }
  /// As those of Actor.
  int64_t head_size() const { return shape_.head_size(); }
  int64_t log_std_offset() const { return shape_.log_std_offset(); }

 private:
  const bool normalize_;
  Actor shape_;  // without a normaliser: the groups have their own
  at::Tensor rows_;
};

/// The networks that groups of worlds were given at the latest draw, and those before: a game that is on at a draw is
/// played to its end by the one that it began with (math/earlier_opponent.hpp).
struct TwoGenerations {
  GroupPolicy now, earlier;
  at::Tensor drawn_at;  // [W] int32, the bits of OpponentDraws::drawn_at
  at::Tensor plays;     // [groups] uint8, whether the earlier one plays in a world of the group; never 0 where it does
  bool any_plays = false;  ///< the same of all groups, as far as the host knows
};

}  // namespace giga
