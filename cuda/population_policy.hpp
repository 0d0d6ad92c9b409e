// The networks of a population in one fused kernel: observation to action, a warp for some worlds of one network.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/population_actions.hpp"
#include "math/small_mlp.hpp"
#include "sim/state.hpp"

namespace giga {

/// Where a network lies in half precision, in the order in which tensor cores take it: of each layer the weights
/// [slabs of 32 inputs][tiles of 8 outputs][32 lanes][8 numbers], zero where a slab or tile is not filled, then the
/// biases of whole tiles; behind all layers the three numbers of log_std. Lane 4 i + j holds for output i of the tile
/// the inputs 2 j and 2 j + 1 of each eighth of the slab (PTX, mma.m16n8k16).
struct PackedMlp {
  static constexpr int kSlab = 32, kTile = 8, kFragment = kSlab * kTile;
  SmallMlp mlp;
  int weight[SmallMlp::kMaxLayers] = {}, bias[SmallMlp::kMaxLayers] = {};
  int log_std = 0;
  int size = 0;  ///< numbers of a network, a multiple of 8

  PackedMlp() = default;
  explicit PackedMlp(const SmallMlp& small) : mlp(small) {
    for (int l = 0; l < mlp.n_layers; ++l) {
      weight[l] = size;
      size += slabs(l) * tiles(l) * kFragment;
      bias[l] = size;
      size += tiles(l) * kTile;
    }
    log_std = size;
    size += kTile;
  }
  GIGA_HD int slabs(int layer) const { return (mlp.width[layer] + kSlab - 1) / kSlab; }
  GIGA_HD int tiles(int layer) const { return (mlp.width[layer + 1] + kTile - 1) / kTile; }
};

/// Queues the packing of networks [n, stride] into `packed` [n, PackedMlp::size].
void pack_population(const PackedMlp& layout, const float* networks, int64_t n, int64_t stride, uint16_t* packed,
                     int index, void* stream);

/// Who moves one team in a part of the worlds: groups of worlds, each with one network.
struct NetworkGroups {
  const uint16_t* networks = nullptr;  // [networks, PackedMlp::size]
  const int32_t* network = nullptr;    // [groups] row of networks; below 0: left out; null: row g
  int groups = 0, worlds_per_group = 0;
  int64_t first_world = 0, group_step = 0, world_step = 0;  // world k of group g: first + g group_step + k world_step
  const float* obs = nullptr;                               // [W, n, obs_stride] of the team, all worlds
  PopulationAct act{};                                      // of all worlds: draws.n agents a world
};

/// How near arithmetics are to each other: the most by which probabilities of actions differ, and logits and means of
/// actions in units of 1 + the largest of their row, for networks with two hidden layers of 64 and tanh, 112 inputs in
/// [-1, 1], and weights of an orthogonal initialisation plus normal numbers of deviation 0.5. kHalfTolerance: fp16
/// (policy/config.hpp), by LibTorch or by the fused kernel, and fp32. kFusedTolerance: the fused kernel and fp16 by
/// LibTorch. tests/policy/half_precision_test.cpp measures both.
constexpr double kHalfTolerance = 0.01, kFusedTolerance = 0.005;

struct PopulationPolicy {
  static constexpr int kMaxParts = 4;
  PackedMlp packed;
  int64_t obs_stride = 0;        ///< numbers from one observation to the next; a multiple of 2
  const Phase* phase = nullptr;  // [W] worlds that wait are left out
  NetworkGroups part[kMaxParts];
  int n_parts = 0;
  /// [population_work(policy) + 1] the pieces of work in which a world plays, then their number, as
  /// list_population_work leaves them; null: each launch looks at all.
  const int32_t* work = nullptr;
};

/// Pieces into which the work of all parts is cut, each for one warp: some worlds of one network.
int population_work(const PopulationPolicy& policy);
/// Queues the listing of the pieces in which a world plays now. The list holds until another world begins to play.
void list_population_work(const PopulationPolicy& policy, int32_t* work, int index, void* stream);

/// Queues the actions of all parts, in the arithmetic that Precision::fp16 names (policy/config.hpp): weights, biases,
/// log_std, observations and features rounded to half precision, 11 bits of which the first is 1; sums in fp32, in
/// another order than LibTorch's; tanh by the hardware, off by up to 2^-11 of its value (PTX, tanh.approx.f32), other
/// activations as everywhere; logits and means of actions in fp32. What lies beyond 65,504 is infinite.
/// How near it is to other arithmetic: kHalfTolerance, kFusedTolerance.
void launch_population_policy(const PopulationPolicy& policy, int index, void* stream);

/// Whether the GPU can do it: tensor cores of compute capability 8.0 or more.
bool population_policy_runs(int index);

}  // namespace giga
