// The networks of a population in one fused kernel: observation to action, a warp for some worlds of one network.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/population_actions.hpp"
#include "math/small_mlp.hpp"
#include "sim/state.hpp"

namespace giga {

/// The layout of a network in half precision, in the order in which tensor cores read it. For each layer: the weights
/// [slabs of 32 inputs][tiles of 8 outputs][32 lanes][8 numbers], padded with zeros to whole slabs and tiles, then the
/// biases of whole tiles. The three numbers of log_std follow the last layer. Lane 4 i + j holds, for output i of the
/// tile, the inputs 2 j and 2 j + 1 of every eight inputs of the slab (PTX, mma.m16n8k16).
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

/// The networks that move one team in a part of the worlds: one for each group of worlds.
struct NetworkGroups {
  const uint16_t* networks = nullptr;  // [networks, PackedMlp::size]
  const int32_t* network = nullptr;    // [groups] row of networks; below 0: left out; null: row g
  int groups = 0, worlds_per_group = 0;
  int64_t first_world = 0, group_step = 0, world_step = 0;  // world k of group g: first + g group_step + k world_step
  const float* obs = nullptr;                               // [W, n, obs_stride] of the team, all worlds
  PopulationAct act{};                                      // of all worlds: draws.n agents a world
};

/// A piece of work, for one warp: worlds in which one network of a part moves its team.
struct PopulationPiece {
  int32_t part, network;
  int32_t first, count;  ///< its worlds in the list of those that play
};

struct PopulationPolicy {
  static constexpr int kMaxParts = 4;
  PackedMlp packed;
  int64_t obs_stride = 0;        ///< numbers from one observation to the next; a multiple of 2
  const Phase* phase = nullptr;  // [W] worlds that wait are left out
  NetworkGroups part[kMaxParts];
  int n_parts = 0;
  int32_t* work = nullptr;  // [population_work(policy)] as list_population_work leaves it, aligned to 16 bytes
};

/// Words of the list of work.
int64_t population_work(const PopulationPolicy& policy);
/// Queues the listing of the worlds that play now, in pieces of one network each: where few of a network's worlds still
/// play, a warp takes them together. The list holds until another world begins to play.
void list_population_work(const PopulationPolicy& policy, int index, void* stream);

/// Queues the actions of the work that is listed in the arithmetic of Precision::fp16 (policy/config.hpp): weights,
/// biases, log_std, observations and features are rounded to half precision (11 significant bits; beyond 65,504
/// infinite); sums, logits and means of actions are fp32. Two things differ from LibTorch: the order of sums, and tanh,
/// which the hardware computes within 2^-11 of its value (PTX, tanh.approx.f32). tests/policy/half_precision_test.cpp
/// measures the difference.
void launch_population_policy(const PopulationPolicy& policy, int index, void* stream);

/// Whether the GPU can run it: tensor cores of compute capability 8.0 or more.
bool population_policy_runs(int index);

}  // namespace giga
