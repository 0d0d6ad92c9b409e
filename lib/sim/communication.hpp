// Who hears whom, and whom an agent therefore sees (rules 6).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/draws.hpp"
#include "sim/movement.hpp"
#include "sim/world.hpp"

namespace giga {

/// Bits of w.hears: whom of its team agent e hears: the living, itself included, the nearer the more likely. A dead
/// agent listens on: the recordings of the original say so (rules 6).
template <class Draws>
GIGA_HD void listen(const Parameters auto& p, World auto& w, Draws& draws, int e, bool after_reset) {
  uint32_t* hears = w.hears + static_cast<int64_t>(e) * words_for(p.n_agents);
  with_comm_draws(p, draws, e, after_reset, [&](auto&& draw) {
    write_team_bits(p, p.team_of(e), hears, [&](int b, int k) {
      if (!w.alive[b]) return false;
      if (b == e) return true;
      const float loss = divide(square_root(planar_distance2(w, e, b)), p.communication_range);
      return clamp(loss, 0.0f, 1.0f) <= draw(b, k);
    });
  });
}

/// Bits of w.seen: agents that e hears, and those that somebody whom e hears detects. Without stochastic communication
/// everybody detected is seen, by the dead too (rules 6).
GIGA_HD void look(const Parameters auto& p, World auto& w, int e) {
  const int n = p.n_agents, words = words_for(n);
  const uint32_t* hears = w.hears + static_cast<int64_t>(e) * words;
  uint32_t* seen = w.seen + static_cast<int64_t>(e) * words;
  if (p.stochastic_communication) {
    // Those whom e hears are of its team, and only opponents detect: no mate is seen by detection.
    write_team_bits(p, 1 - p.team_of(e), seen, [&](int a, int) {
      const uint32_t* detected = w.detected + static_cast<int64_t>(a) * words;
      uint32_t known = 0;
      for (int k = 0; k < words; ++k) known |= detected[k] & hears[k];
      return known != 0;
    });
    for (int k = 0; k < words; ++k) seen[k] |= hears[k];
  } else {
    for (int word = 0; word < words; ++word) {
      uint32_t bits = 0;
      const int end = (word + 1) * 32 < n ? (word + 1) * 32 : n;
      for (int a = word * 32; a < end; ++a) {
        uint32_t known = p.team_of(a) == p.team_of(e) && w.alive[a] ? 1u : 0u;
        for (int k = 0; k < words; ++k) known |= w.detected[static_cast<int64_t>(a) * words + k];
        if (known) bits |= 1u << (a & 31);
      }
      seen[word] = bits;
    }
  }
}

}  // namespace giga
