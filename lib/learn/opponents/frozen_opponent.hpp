// FrozenOpponent: the policy or mixed team that train.opponent names, which a learning team meets everywhere.
#pragma once

#include <string>

#include "core/named_array.hpp"
#include "game/game.hpp"
#include "learn/opponents/world_shares.hpp"
#include "learn/players/player.hpp"

namespace giga {

class FrozenOpponent {
 public:
  /// Throws InputError, with the place of train.opponent where it is known, where it cannot be read or cannot play the
  /// run's game.
  FrozenOpponent(const LoadedRun& run, Device device);

  Player& player() { return player_; }
  /// What moves a team in all worlds; valid while this lives.
  Side side(int team, const LoadedRun& run, const WorldShares& worlds, const Simulator& sim);

  void save(NamedArrays& out) const;
  /// Throws InputError where the run that was saved met others: who plays, in their order, and their files count.
  void check_same(const NamedArrays& in) const;

 private:
  Player player_;
  const int64_t fingerprint_;
};

}  // namespace giga
