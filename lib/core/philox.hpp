// Counter-based random numbers: Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011).
// A draw is a pure function of (seed, world, step, purpose, indices): nothing is stored, and every back end and any
// number of threads sees the same numbers.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "core/quotient.hpp"

namespace giga {

struct Philox4 {
  uint32_t word[4];
};

/// 32 x 32 -> 64 bit multiplication, high half.
GIGA_HD uint32_t mul_hi(uint32_t a, uint32_t b) {
#if defined(__CUDA_ARCH__)
  return __umulhi(a, b);
#else
  return static_cast<uint32_t>((static_cast<uint64_t>(a) * b) >> 32);
#endif
}

constexpr int kPhiloxRounds = 10;

/// Rounds of Philox4x32 over a 128-bit counter with a 64-bit key.
GIGA_HD Philox4 philox4x32(uint32_t c0, uint32_t c1, uint32_t c2, uint32_t c3, uint64_t key) {
  uint32_t k0 = static_cast<uint32_t>(key), k1 = static_cast<uint32_t>(key >> 32);
  for (int round = 0; round < kPhiloxRounds; ++round) {
    const uint32_t hi0 = mul_hi(0xD2511F53u, c0), lo0 = 0xD2511F53u * c0;
    const uint32_t hi1 = mul_hi(0xCD9E8D57u, c2), lo1 = 0xCD9E8D57u * c2;
    c0 = hi1 ^ c1 ^ k0;
    c1 = lo1;
    c2 = hi0 ^ c3 ^ k1;
    c3 = lo0;
    k0 += 0x9E3779B9u;
    k1 += 0xBB67AE85u;
  }
  return {{c0, c1, c2, c3}};
}

/// The keys of all rounds. A kernel that gets them as arguments reads them where it uses them; made anew from one key,
/// they stay in 20 registers of each thread.
struct PhiloxKeys {
  uint32_t k0[kPhiloxRounds], k1[kPhiloxRounds];

  PhiloxKeys() = default;
  explicit PhiloxKeys(uint64_t key) {
    for (uint32_t round = 0; round < kPhiloxRounds; ++round) {
      k0[round] = static_cast<uint32_t>(key) + round * 0x9E3779B9u;
      k1[round] = static_cast<uint32_t>(key >> 32) + round * 0xBB67AE85u;
    }
  }
};
/// The same as of the key they were made of.
GIGA_HD Philox4 philox4x32(uint32_t c0, uint32_t c1, uint32_t c2, uint32_t c3, const PhiloxKeys& keys) {
  GIGA_UNROLL
  for (int round = 0; round < kPhiloxRounds; ++round) {
    const uint32_t hi0 = mul_hi(0xD2511F53u, c0), lo0 = 0xD2511F53u * c0;
    const uint32_t hi1 = mul_hi(0xCD9E8D57u, c2), lo1 = 0xCD9E8D57u * c2;
    c0 = hi1 ^ c1 ^ keys.k0[round];
    c1 = lo1;
    c2 = hi0 ^ c3 ^ keys.k1[round];
    c3 = lo0;
  }
  return {{c0, c1, c2, c3}};
}

/// The upper 24 bits as a float in [0, 1): exact, so the same on every back end.
GIGA_HD float to_unit_float(uint32_t bits) { return static_cast<float>(bits >> 8) * (1.0f / 16777216.0f); }

/// That of number `index`, whose block this is. Selected without indexing, so that the block stays in registers.
GIGA_HD float unit_float_of(const Philox4& block, uint32_t index) {
  const uint32_t slot = index & 3u;
  const uint32_t bits = slot == 0   ? block.word[0]
                        : slot == 1 ? block.word[1]
                        : slot == 2 ? block.word[2]
                                    : block.word[3];
  return to_unit_float(bits);
}

/// The number under which world `world` draws: `first` is that of world 0; worlds a whole `period` apart draw the same
/// numbers (0 = all draw apart).
GIGA_HD uint32_t draw_world(int64_t first, int64_t period, int64_t world) {
  return static_cast<uint32_t>(first + (period > 0 ? left_over(world, period) : world));
}

/// The number of an agent as part of a row, with bit 16 left free for what tells two kinds of rows apart: a reset, a
/// team. Numbers below 65,536 stay as they are.
GIGA_HD uint32_t draw_slot(uint32_t number) { return (number & 0xFFFFu) | (number >> 16 << 17); }

/// What a draw decides; part of the counter, so that no two purposes share numbers. Each keeps its number for good.
enum class Draw : uint32_t { waypoint, detect, comm, map, start, action, opponent, init = 8, es_noise, pool };

/// The draws of one world at one step, addressed by purpose and indices. Consecutive indices share a Philox call,
/// whose result is remembered.
class DrawKey {
 public:
  GIGA_HD DrawKey(uint64_t seed, uint32_t world, uint32_t step) : seed_(seed), world_(world), step_(step) {}

  /// Four draws as bits: numbers 4 `block` to 4 `block` + 3 of row `row`.
  GIGA_HD Philox4 bits(Draw draw, uint32_t row, uint32_t block) const {
    return philox4x32(world_, step_, (static_cast<uint32_t>(draw) << 24) | block, row, seed_);
  }

  /// Uniform on [0, 1): number `index` of row `row`. Needs an index below 2^26.
  GIGA_HD float uniform(Draw draw, uint32_t row, uint32_t index) {
    const uint32_t purpose = (static_cast<uint32_t>(draw) << 24) | (index >> 2);
    if (purpose != cached_purpose_ || row != cached_row_) {
      cached_ = bits(draw, row, index >> 2);
      cached_purpose_ = purpose;
      cached_row_ = row;
    }
    return unit_float_of(cached_, index);
  }

 private:
  uint64_t seed_;
  uint32_t world_, step_;
  uint32_t cached_purpose_ = 0xFFFFFFFFu, cached_row_ = 0xFFFFFFFFu;
  Philox4 cached_{};
};

/// The same with the keys of all rounds, which it refers to, and without memory.
class ScheduledKey {
 public:
  GIGA_HD ScheduledKey(const PhiloxKeys& keys, uint32_t world, uint32_t step)
      : keys_(keys), world_(world), step_(step) {}

  GIGA_HD float uniform(Draw draw, uint32_t row, uint32_t index) const {
    return unit_float_of(philox4x32(world_, step_, (static_cast<uint32_t>(draw) << 24) | (index >> 2), row, keys_),
                         index);
  }

 private:
  const PhiloxKeys& keys_;
  uint32_t world_, step_;
};

/// The draws of a row whose indices are the agents of a team, all made at once: on the GPU the threads of a warp keep
/// in step that way. Teams of kTeam0 and kTeam1 agents.
template <int kTeam0, int kTeam1>
class TeamUniforms {
 public:
  GIGA_HD TeamUniforms(const DrawKey& key, Draw draw, uint32_t row, int team) {
    uint32_t all[4 * kBlocks];
    const uint32_t first = team == 0 ? 0u : static_cast<uint32_t>(kTeam0) / 4;
    GIGA_UNROLL
    for (int b = 0; b < kBlocks; ++b) {
      const Philox4 four = key.bits(draw, row, first + static_cast<uint32_t>(b));
      GIGA_UNROLL
      for (int k = 0; k < 4; ++k) all[4 * b + k] = four.word[k];
    }
    GIGA_UNROLL
    for (int k = 0; k < kTeam; ++k) bits_[k] = team == 0 || k + kShift >= 4 * kBlocks ? all[k] : all[k + kShift];
  }
  /// That of the team's agent k.
  GIGA_HD float operator()(int k) const { return to_unit_float(bits_[k]); }

 private:
  static constexpr int kTeam = kTeam0 > kTeam1 ? kTeam0 : kTeam1;
  static constexpr int kShift = kTeam0 % 4;  // where the draws of team 1 begin in their block
  static constexpr int kBlocks = ((kTeam0 > kShift + kTeam1 ? kTeam0 : kShift + kTeam1) + 3) / 4;
  uint32_t bits_[kTeam];
};

}  // namespace giga
