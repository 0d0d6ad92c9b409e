// Who hears whom, and whom an agent therefore sees (rules 6).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/world.hpp"

namespace giga {

/// Bits of w.hears: whom of its team agent e hears: the living, itself included, the nearer the more likely. A dead
/// agent listens on: the recordings of the original say so (rules 6).
template <class Draws>
GIGA_HD void listen(const Parameters auto& p, World auto& w, Draws& draws, int e, bool after_reset) {
  const int n = p.n_agents, words = words_for(n);
  for (int word = 0; word < words; ++word) {
    uint32_t bits = 0;
    const int end = (word + 1) * 32 < n ? (word + 1) * 32 : n;
    for (int b = word * 32; b < end; ++b) {
      if (p.team_of(b) != p.team_of(e) || !w.alive[b]) continue;
      bool heard = b == e;
      if (!heard) {
        const float dx = w.x[e] - w.x[b], dy = w.y[e] - w.y[b];
        const float loss = std::sqrt(dx * dx + dy * dy) / p.communication_range;
        heard = clamp(loss, 0.0f, 1.0f) <= draws.comm(e, b, after_reset);
      }
      if (heard) bits |= 1u << (b & 31);
    }
    w.hears[static_cast<int64_t>(e) * words + word] = bits;
  }
}

/// Bits of w.seen: agents that e hears, and those that somebody whom e hears detects. Without stochastic communication
/// everybody detected is seen, by the dead too (rules 6).
GIGA_HD void look(const Parameters auto& p, World auto& w, int e) {
  const int n = p.n_agents, words = words_for(n);
  const uint32_t* hears = w.hears + static_cast<int64_t>(e) * words;
  for (int word = 0; word < words; ++word) {
    uint32_t bits = p.stochastic_communication ? hears[word] : 0u;
    const int end = (word + 1) * 32 < n ? (word + 1) * 32 : n;
    for (int a = word * 32; a < end; ++a) {
      const uint32_t* detected = w.detected + static_cast<int64_t>(a) * words;
      uint32_t known = 0;
      for (int k = 0; k < words; ++k) known |= p.stochastic_communication ? detected[k] & hears[k] : detected[k];
      if (!p.stochastic_communication && p.team_of(a) == p.team_of(e) && w.alive[a]) known = 1;
      if (known) bits |= 1u << (a & 31);
    }
    w.seen[static_cast<int64_t>(e) * words + word] = bits;
  }
}

}  // namespace giga
