// Who hears whom, and whom an agent therefore sees (rules 6).
#pragma once

#include <cmath>

#include "core/geometry.hpp"
#include "sim/draws.hpp"
#include "sim/movement.hpp"
#include "sim/world.hpp"

namespace giga {

/// Whether an agent hears a mate at that squared distance.
GIGA_HD bool hears_at(const Parameters auto& p, float d2, float draw) {
  const float loss = divide(square_root(d2), p.communication_range);
  return clamp(loss, 0.0f, 1.0f) <= draw;
}

/// The same without root and quotient, where that is clear: the roundings on both ways together make an error below a
/// part in 1.8 million.
struct Hearing {
  bool heard, clear;
};
GIGA_HD Hearing roughly_hears_at(const Parameters auto& p, float d2, float draw) {
  constexpr float kPart = 1.0f / (1 << 20), kSmall = 1e-30f;  // below the latter numbers have fewer digits
  const float reach = p.communication_range * draw, reach2 = reach * reach;
  const bool heard = d2 + kSmall < reach2 * (1.0f - kPart);
  const bool unheard = d2 - kSmall > reach2 * (1.0f + kPart);
  return {heard, heard || unheard};
}

/// Bits of w.hears: whom of its team agent e hears: the living, itself included, the nearer the more likely. A dead
/// agent listens on: the recordings of the original say so (rules 6).
template <class Draws>
GIGA_HD void listen(const Parameters auto& p, World auto& w, Draws& draws, int e, bool after_reset) {
  uint32_t* hears = w.hears + static_cast<int64_t>(e) * words_for(p.n_agents);
  with_comm_draws(p, draws, e, after_reset, [&](auto&& draw) {
    const int team = p.team_of(e);
    const auto exactly = [&](int b, auto&& draw_of) {
      if (!w.alive[b]) return false;
      return b == e || hears_at(p, planar_distance2(w, e, b), draw_of());
    };
    if constexpr (std::remove_cvref_t<decltype(p)>::kTeam > 0) {
      uint32_t bits = 0, open = 0;
      for_team(p, team, [&](int b, int k) {
        const Hearing h = roughly_hears_at(p, planar_distance2(w, e, b), draw(b, k));
        bits |= h.heard & (w.alive[b] != 0) ? 1u << k : 0u;
        open |= h.clear ? 0u : 1u << k;
      });
      for (; open; open &= open - 1) {  // hardly ever
        const int k = lowest_bit(open), b = p.first_of(team) + k;
        if (exactly(b, [&] { return draws.comm(e, b, after_reset); })) bits |= 1u << k;
      }
      write_team_bits(p, team, hears, bits);
    } else {
      write_team_bits(p, team, hears, [&](int b, int k) { return exactly(b, [&] { return draw(b, k); }); });
    }
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
