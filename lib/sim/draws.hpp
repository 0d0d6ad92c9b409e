// Draw sources: where a step's and a reset's uniform numbers come from. PhiloxDraws computes them; tests hand in
// recorded ones through a type with the same functions.
#pragma once

#include "core/philox.hpp"
#include "sim/params.hpp"

namespace giga {

/// Coordinates that a reset draws for an agent.
enum class StartDraw : int { x, y, z, heading };

/// The draws of one world at one step, by a DrawKey or what has the same draws. All uniform on [0, 1) but `map`.
template <class Key>
class KeyedDraws {
 public:
  GIGA_HD explicit KeyedDraws(const Key& key) : key_(key) {}

  GIGA_HD float waypoint_appears() { return key_.uniform(Draw::waypoint, 0, 0); }
  GIGA_HD float waypoint_location(int axis) { return key_.uniform(Draw::waypoint, 0, 1 + static_cast<uint32_t>(axis)); }
  GIGA_HD float waypoint_time() { return key_.uniform(Draw::waypoint, 0, 3); }
  /// Does `observer` detect `target`?
  GIGA_HD float detect(int target, int observer) {
    return key_.uniform(Draw::detect, static_cast<uint32_t>(target), static_cast<uint32_t>(observer));
  }
  /// Does `ego` hear `sender`? A step and the reset that follows it draw apart (`after_reset`).
  GIGA_HD float comm(int ego, int sender, bool after_reset) {
    return key_.uniform(Draw::comm, comm_row(ego, after_reset), static_cast<uint32_t>(sender));
  }
  /// Index of the map of the next episode, uniform over n_maps.
  GIGA_HD int map(int n_maps) {
    const int index = static_cast<int>(key_.uniform(Draw::map, 0, 0) * static_cast<float>(n_maps));
    return index < n_maps ? index : n_maps - 1;
  }
  /// Start coordinate of an agent; round 0 is the first draw, 1 to 3 the rounds of resampling.
  GIGA_HD float start(int agent, int round, StartDraw what) {
    const uint32_t index = static_cast<uint32_t>(round) * 4 + static_cast<uint32_t>(what);
    return key_.uniform(Draw::start, static_cast<uint32_t>(agent), index);
  }

 protected:
  GIGA_HD static uint32_t comm_row(int ego, bool after_reset) {
    return static_cast<uint32_t>(ego) + (after_reset ? 0x10000u : 0u);
  }

  Key key_;
};

class PhiloxDraws : public KeyedDraws<DrawKey> {
 public:
  GIGA_HD PhiloxDraws(uint64_t seed, uint32_t world, uint32_t step) : KeyedDraws(DrawKey(seed, world, step)) {}

  /// The same for all observers, or senders, of a team, of kTeam0 and kTeam1 agents.
  template <int kTeam0, int kTeam1>
  GIGA_HD TeamUniforms<kTeam0, kTeam1> detect_by(int target, int team) const {
    return {key_, Draw::detect, static_cast<uint32_t>(target), team};
  }
  template <int kTeam0, int kTeam1>
  GIGA_HD TeamUniforms<kTeam0, kTeam1> comm_from(int ego, int team, bool after_reset) const {
    return {key_, Draw::comm, comm_row(ego, after_reset), team};
  }
};

/// Whether a source of draws makes those of a whole team at once, for these parameters.
template <class P, class Draws>
concept DrawsByTeam = (P::kTeam > 0) && requires(const Draws& draws) {
  draws.template detect_by<P::kTeam0, P::kTeam1>(0, 0);
};

/// Calls f(draw), where draw(b, k) says whether agent b detects target a: b is number k of the team that observes it.
template <Parameters P, class Draws, class F>
GIGA_HD void with_detect_draws(const P& p, Draws& draws, int a, F&& f) {
  if constexpr (DrawsByTeam<P, Draws>) {
    const auto all = draws.template detect_by<P::kTeam0, P::kTeam1>(a, 1 - p.team_of(a));
    f([&](int, int k) { return all(k); });
  } else {
    f([&](int b, int) { return draws.detect(a, b); });
  }
}
/// Likewise whether agent e hears agent b, number k of its own team.
template <Parameters P, class Draws, class F>
GIGA_HD void with_comm_draws(const P& p, Draws& draws, int e, bool after_reset, F&& f) {
  if constexpr (DrawsByTeam<P, Draws>) {
    const auto all = draws.template comm_from<P::kTeam0, P::kTeam1>(e, p.team_of(e), after_reset);
    f([&](int, int k) { return all(k); });
  } else {
    f([&](int b, int) { return draws.comm(e, b, after_reset); });
  }
}

}  // namespace giga
