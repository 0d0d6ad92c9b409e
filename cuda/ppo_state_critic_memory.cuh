// The shared memory of a block of the kernels of critics of the true state, and what goes into it.
#pragma once

#include "cuda/ppo_block_tiles.cuh"
#include "cuda/ppo_value_loss.cuh"

namespace giga {

/// The shape of a block's tiles, for so many numbers in a hidden layer. A warp has 32 columns of 16 kRowTiles rows.
template <int kHidden_>
struct StateShape {
  static constexpr int kHidden = kHidden_, kStride = kHidden + 8, kDepth = kHidden / 16, kPairs = kHidden / 2;
  static constexpr int kWarps = 8, kThreads = kWarps * 32;
  static constexpr int kRows = KeptTrueStates::kTileRows, kRowDepth = kRows / 16;  // of each team
  static constexpr int kRowTiles = kHidden / 64, kTiles = 4;
  static constexpr int kColumnParts = kHidden / 32;    // warps that have the same rows
  static constexpr int kIn = 16, kInStride = kIn + 8;  // of an agent: its numbers, 1, zeros
  static constexpr int kWorld = FusedState::kMostWorld + 1, kWorldStride = kWorld + 8;  // likewise
  static constexpr int kStates = KeptTrueStates::kMost;
  static constexpr int kProductStride = kHidden + 4;  // floats: states that are read together lie on different banks
  static_assert(kHidden % 64 == 0 && kRows / (16 * kRowTiles) * kColumnParts == kWarps);
  static_assert(kWorld % 16 == 0 && kStates == 16);
};

/// Which of both teams' numbers: of those whose values it is about, or of the others.
enum TeamOf : int { kOwnTeam, kOtherTeam };

template <class S>
struct StateMemory {
  alignas(16) float numbers[2 * S::kRows * S::kIn + S::kStates * S::kWorld];  // of the next tile's states, as they lie
  alignas(16) __half agents[2][S::kRows * S::kInStride];
  // Codes; of the others then their slopes; then the gradients by the sums of the first layer.
  alignas(16) __half codes[2][S::kRows * S::kStride];
  alignas(16) __half gradient[S::kRows * S::kStride];  // by the sums of the second layer
  alignas(16) __half mean[2][S::kStates * S::kStride];
  alignas(16) __half world[S::kStates * S::kWorldStride];
  alignas(16) __half totals[S::kStates * S::kStride];  // sums of `gradient` over the rows of a state
  // What a state adds to the sums of its rows; going back, the gradients by the means.
  alignas(16) float products[2][S::kStates * S::kProductStride];
  alignas(16) __half encoder[S::kHidden * S::kInStride];
  alignas(16) __half of_own[S::kHidden * S::kStride], of_mean[2][S::kHidden * S::kStride];
  alignas(16) __half of_world[S::kHidden * S::kWorldStride];
  alignas(16) float bias1[S::kHidden], bias2[S::kHidden], weight3[S::kHidden];
  alignas(16) float dots[S::kRows][4];  // a row's features times weight3, in parts
  float by_value[S::kRows];
  float share[2][S::kRows];  // of the mean of its team: 1 / living; 0 for the dead
  int place[2][S::kRows];    // of the agent in `numbers`; -1: no agent
  int state[2][S::kRows];    // in the tile; -1: none
  float unscale, scale, sums[2][S::kWarps];
  int64_t source[2][S::kStates];  // states of the rollout, of this tile and the next; -1: none
};

/// Where the numbers of a tile's states come from.
struct StateTiles {
  int n[2], first[2];  // agents of a team, the first of them; as TeamOf
  int input, world;    // numbers of an agent, of the world
  int numbers;         // of a state
  int states;          // of a tile
  int64_t n_tiles;

  __device__ explicit StateTiles(const FusedCritic& k)
      : n{k.rows.n, k.net.state.n_other},
        first{k.net.state.first_own, k.net.state.first_other},
        input(k.net.width[0]),
        world(k.net.state.world),
        numbers((n[0] + n[1]) * input + world),
        states(KeptTrueStates::states_of_tile(n[0], n[1])),
        n_tiles((k.rows.n_states + states - 1) / states) {}
  /// A state of the rollout; -1 beyond the last.
  __device__ int64_t source(const FusedRows& rows, int64_t tile, int state) const {
    const int64_t at = tile * states + state;
    if (state >= states || tile >= n_tiles || at >= rows.n_states) return -1;
    return rows.states ? rows.states[at] : at;
  }
};

template <class S>
__device__ void load_network(const FusedCritic& k, const StateTiles& tiles, StateMemory<S>& m) {
  const FusedMlp& net = k.net;
  const int codes = net.width[1], hidden = net.width[2], reads = net.state.inputs(codes);
  const float* reader = k.parameters + net.weight[1];
  load_matrix<S::kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], codes, tiles.input, m.encoder);
  load_columns<S::kHidden, S::kStride, S::kThreads>(reader, hidden, codes, reads, m.of_own);
  for (int team = 0; team < 2; ++team)
    load_columns<S::kHidden, S::kStride, S::kThreads>(reader + (1 + team) * codes, hidden, codes, reads,
                                                      m.of_mean[team]);
  load_columns<S::kHidden, S::kWorldStride, S::kThreads>(reader + 3 * codes, hidden, tiles.world, reads, m.of_world);
  load_vector(k.parameters + net.bias[0], codes, m.bias1, S::kHidden);
  load_vector(k.parameters + net.bias[1], hidden, m.bias2, S::kHidden);
  load_vector(k.parameters + net.weight[2], hidden, m.weight3, S::kHidden);
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < 2 * S::kRows) {
    const int team = thread / S::kRows, row = thread % S::kRows, n = team == 0 ? tiles.n[0] : tiles.n[1];
    const int state = row / n, first = team == 0 ? tiles.first[0] : tiles.first[1];
    const bool some = state < tiles.states;
    m.state[team][row] = some ? state : -1;
    m.place[team][row] = some ? state * tiles.numbers + (first + row - state * n) * tiles.input : -1;
  }
  // Of a tile with fewer states nothing is ever written to the others' rows.
  for (int i = thread; i < S::kStates * S::kStride; i += S::kThreads)
    m.mean[0][i] = m.mean[1][i] = m.totals[i] = __half(0);
  for (int i = thread; i < S::kStates * S::kWorldStride; i += S::kThreads) m.world[i] = __half(0);
  for (int i = thread; i < S::kRows * 4; i += S::kThreads) m.dots[i / 4][i % 4] = 0;
  if (thread >= 32 || k.values) return;
  const BatchMoments moments(k.moments);
  if (thread > 0) return;
  take_scale(k, moments, m);
}

/// The numbers of the states m.source[turn] on their way to m.numbers: each thread waits for its own.
template <class S>
__device__ void fetch_numbers(const FusedRows& rows, const StateTiles& tiles, StateMemory<S>& m, int turn) {
  const int warp = static_cast<int>(threadIdx.x) / 32, lane = static_cast<int>(threadIdx.x) % 32;
  for (int s = warp; s < tiles.states; s += S::kWarps) {
    const int64_t source = m.source[turn][s];
    const float* from = rows.obs + (source >= 0 ? source : 0) * rows.obs_stride;
    const uint32_t to = static_cast<uint32_t>(__cvta_generic_to_shared(m.numbers + s * tiles.numbers));
    for (int c = lane; c < tiles.numbers; c += 32)
      asm volatile("cp.async.ca.shared.global [%0], [%1], 4, %2;" ::"r"(to + static_cast<uint32_t>(c) * 4),
                   "l"(from + c), "r"(source >= 0 ? 4 : 0)
                   : "memory");
  }
}

/// What the layers read, from m.numbers. `kept`: of the world, if any; a row for each state.
template <class S>
__device__ void take_numbers(const StateTiles& tiles, StateMemory<S>& m, uint32_t* kept) {
  const int thread = static_cast<int>(threadIdx.x);
  constexpr int kAgentPairs = S::kIn / 2, kWorldPairs = S::kWorld / 2;
  const auto number = [&](int first, int c, int count) {
    return c < count ? m.numbers[first + c] : c == count ? 1.0f : 0.0f;
  };
#pragma unroll
  for (int i = thread; i < 2 * S::kRows * kAgentPairs; i += S::kThreads) {
    const int c = i % kAgentPairs * 2, row = i / kAgentPairs % S::kRows, team = i / kAgentPairs / S::kRows;
    const int place = m.place[team][row];
    *reinterpret_cast<uint32_t*>(m.agents[team] + row * S::kInStride + c) =
        place < 0 ? 0 : half_pair(number(place, c, tiles.input), number(place, c + 1, tiles.input));
  }
  for (int i = thread; i < tiles.states * kWorldPairs; i += S::kThreads) {
    const int pair = i % kWorldPairs, c = pair * 2, s = i / kWorldPairs;
    const int first = (s + 1) * tiles.numbers - tiles.world;
    const uint32_t both = half_pair(number(first, c, tiles.world), number(first, c + 1, tiles.world));
    *reinterpret_cast<uint32_t*>(m.world + s * S::kWorldStride + c) = both;
    if (kept) kept[s * S::kPairs + pair] = both;
  }
  if (thread < 2 * S::kRows) {
    const int team = thread / S::kRows, row = thread % S::kRows, n = team == 0 ? tiles.n[0] : tiles.n[1];
    const int place = m.place[team][row];
    float share = 0;
    if (place >= 0 && m.numbers[place] != 0) {  // the first number of an agent says whether it lives
      int living = 0;
      for (int i = 0, at = place - row % n * tiles.input; i < n; ++i, at += tiles.input)
        living += m.numbers[at] != 0 ? 1 : 0;
      share = 1.0f / static_cast<float>(living);
    }
    m.share[team][row] = share;
  }
}

}  // namespace giga
