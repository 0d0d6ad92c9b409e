// Noise of evolution strategies: a pure function of (seed, generation, pair of members, parameter), made anew wherever
// it is needed and never stored.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/host_device.hpp"
#include "core/philox.hpp"
#include "math/normal.hpp"

namespace giga {

/// The perturbations of one team's population in one generation.
struct EsNoise {
  uint64_t seed;
  uint32_t generation;
  uint32_t team;
  int antithetic;  // 1: members 2 k and 2 k + 1 have the same numbers with opposite signs (Salimans et al. 2017)
  int rank;        // 0: every parameter has a number of its own; else of perturbations A B^T / sqrt(rank)
  const int32_t*
      left;  // [P] rank > 0: first of the `rank` numbers of the parameter's row of A; -1: a number of its own
  const int32_t* right;  // [P] likewise of its column of B
  int64_t n_parameters;  // P; the numbers of A and B are counted from here on

  /// Number `index` of a pair of members, standard normal.
  GIGA_HD float normal(uint32_t pair, uint32_t index) const {
    const Philox4 bits =
        philox4x32(pair, generation, (static_cast<uint32_t>(Draw::es_noise) << 24) | team, index >> 2, seed);
    const bool upper = (index & 2u) != 0;
    const NormalPair two = normal_pair(to_unit_float(upper ? bits.word[2] : bits.word[0]),
                                       to_unit_float(upper ? bits.word[3] : bits.word[1]));
    return (index & 1u) ? two.second : two.first;
  }

  /// The perturbation of parameter `p` of member `m`, before it is scaled by sigma.
  GIGA_HD float operator()(int64_t m, int64_t p) const {
    const auto pair = static_cast<uint32_t>(antithetic ? m / 2 : m);
    const float sign = antithetic && (m & 1) ? -1.0f : 1.0f;
    if (rank == 0 || left[p] < 0) return sign * normal(pair, static_cast<uint32_t>(p));
    float sum = 0;
    for (int k = 0; k < rank; ++k)
      sum += normal(pair, static_cast<uint32_t>(n_parameters + left[p] + k)) *
             normal(pair, static_cast<uint32_t>(n_parameters + right[p] + k));
    return sign * sum / std::sqrt(static_cast<float>(rank));
  }
};

/// Members of a population, from `first` on: row = member x P + parameter.
struct PerturbMembers {
  EsNoise noise;
  int64_t first;
  const float* mean;   // [P]
  const float* sigma;  // [P]
  float* members;      // [M, P] out

  GIGA_HD void operator()(int64_t row) const {
    const int64_t m = row / noise.n_parameters, p = row - m * noise.n_parameters;
    members[row] = mean[p] + sigma[p] * noise(first + m, p);
  }
};

/// Weighted sums of the noise and of its square, from which every strategy here learns, over parts of the members, for
/// n of the parameters: row = part x n + parameter. The order of the additions is fixed.
struct NoiseMoments {
  static constexpr int64_t kPart = 128;  ///< members of a part; the last has what is left

  EsNoise noise;
  int64_t first_parameter, n;
  const float* weight;  // [M]
  int64_t n_members;    // M
  float* first;         // [parts, n] out: sum of weight x noise
  float* second;        // [parts, n] out: sum of weight x noise^2

  static constexpr int64_t parts(int64_t members) { return (members + kPart - 1) / kPart; }

  GIGA_HD void operator()(int64_t row) const {
    const int64_t part = row / n, p = first_parameter + row - part * n;
    const int64_t begin = part * kPart, end = begin + kPart < n_members ? begin + kPart : n_members;
    float sum = 0, square_sum = 0;
    for (int64_t m = begin; m < end; ++m) {
      const float e = noise(m, p), w = weight[m];
      sum += w * e;
      square_sum += w * e * e;
    }
    first[row] = sum;
    second[row] = square_sum;
  }
};

/// The sums of these parts, in their order, whoever has how many of the parameters.
struct SumOfParts {
  int64_t n_parts, n;
  const float* parts;  // [n_parts, n]
  float* sums;         // [n] out

  GIGA_HD void operator()(int64_t k) const {
    float sum = parts[k];
    for (int64_t part = 1; part < n_parts; ++part) sum += parts[part * n + k];
    sums[k] = sum;
  }
};

}  // namespace giga
