// The shared memory of a block of the critics' kernels for hidden layers of up to 128, and its load of the network.
#pragma once

#include "cuda/ppo_block_tiles.cuh"
#include "cuda/ppo_value_loss.cuh"

namespace giga {

constexpr int kTeamStride = FusedMlp::kBlockHidden + 4;  // floats: states that are read together lie on different banks
constexpr int kColumnParts = 4;                          // of a layer: warps that have the same rows
constexpr int kMostStates = KeptStates::kMost, kPairs = KeptStates::kWords;

/// What only critics with team weights have of it.
template <class S, bool kTeam>
struct BlockTeamMemory {};
template <class S>
struct BlockTeamMemory<S, true> {
  alignas(16) __half states[kMostStates * S::kStride];    // mean features of the first layer; then G
  alignas(16) float products[kMostStates * kTeamStride];  // with the team weight
};
template <class S, bool kTeam>
struct BlockTeamWeight {};
template <class S>
struct BlockTeamWeight<S, true> {
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) float weight3[S::kHidden];
  float inv_living[kMostStates];  // 1 / living agents of a state; 0: nobody lives
};
template <class S, bool kOwn>
struct BlockLayers {  // gradients by the sums of a layer take the place of features
  alignas(16) __half hidden1[S::kLayerHalves];
  alignas(16) __half hidden2[S::kLayerHalves];
  __device__ __half* gradient2() { return hidden2; }
};
template <class S>
struct BlockLayers<S, true> {
  alignas(16) __half hidden1[S::kLayerHalves];
  alignas(16) __half hidden2[S::kLayerHalves];
  alignas(16) __half second[S::kLayerHalves];
  __device__ __half* gradient2() { return second; }
};

/// Shared memory of a block.
template <class S, bool kTeam>
struct BlockCriticMemory {
  BlockKeptSlopes<S, (S::kKeptSlopes > 0)> slopes1;
  BlockKeptSlopes<S, (S::kKeptSlopes > 1)> slopes2;
  alignas(16) __half x[S::kRows * S::kInStride];
  // The inputs of the next tile come while nothing of this is read: with gradients of their own while the last product
  // of a tile runs, else between two tiles.
  struct Features : BlockLayers<S, S::kOwnGradients>, BlockTeamMemory<S, kTeam> {};
  union {
    Features of;
    StagedInputs<S> next;
  };
  alignas(16) __half first[S::kOwnGradients ? S::kLayerHalves : 8];
  alignas(16) __half value[S::kRows * kValueStride];  // the gradient by the own part of the value, and by the team's
  alignas(16) __half weight1[S::kHidden * S::kInStride];
  alignas(16) __half weight2[S::kHidden * S::kStride];
  alignas(16) float bias1[S::kHidden], bias2[S::kHidden], weight3[S::kHidden];
  BlockTeamWeight<S, kTeam> team;
  alignas(16) float dots[2][S::kRows][kColumnParts];  // a row's features times weight3, times the team's
  float2 by_value[S::kRows];                          // the gradients by the parts of the value, in fp32
  float d_value[S::kRows];
  int state[S::kRows];  // of each row, in the tile; -1: none
  uint8_t alive[S::kRows];
  float unscale;  // gradients are 1 / (unscale living rows) times too large
  float scale, sums[2][S::kWarps];
  int64_t source[2][S::kRows];  // of this tile and the next

  __device__ __half* gradient1() { return S::kOwnGradients ? first : of.hidden1; }
};

template <class S, bool kTeam>
__device__ void load_network(const FusedCritic& k, BlockCriticMemory<S, kTeam>& m, int n, int states) {
  const FusedMlp& net = k.net;
  const int input = net.width[0], hidden1 = net.width[1], hidden2 = net.width[2];
  load_matrix<S::kHidden, S::kInStride, S::kThreads>(k.parameters + net.weight[0], hidden1, input, m.weight1);
  load_matrix<S::kHidden, S::kStride, S::kThreads>(k.parameters + net.weight[1], hidden2, hidden1, m.weight2);
  load_vector(k.parameters + net.bias[0], hidden1, m.bias1, S::kHidden);
  load_vector(k.parameters + net.bias[1], hidden2, m.bias2, S::kHidden);
  load_vector(k.parameters + net.weight[2], hidden2, m.weight3, S::kHidden);
  if constexpr (kTeam) {
    load_matrix<S::kHidden, S::kStride, S::kThreads>(k.parameters + net.team_weight[1], hidden2, hidden1,
                                                     m.team.weight2);
    load_vector(k.parameters + net.team_weight[2], hidden2, m.team.weight3, S::kHidden);
  }
  const int thread = static_cast<int>(threadIdx.x);
  if (thread < S::kRows) m.state[thread] = thread < states * n ? thread / n : -1;
  for (int i = thread; i < S::kRows * kValueStride; i += S::kThreads) m.value[i] = __half(0);
  if (thread >= 32 || k.values) return;
  const BatchMoments moments(k.moments);
  if (thread > 0) return;
  take_scale(k, moments, m);
}

}  // namespace giga
