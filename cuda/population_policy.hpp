// The networks of a population in one fused kernel: observation to action with a network's weights in shared memory.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/activation.hpp"
#include "math/population_actions.hpp"
#include "sim/state.hpp"

namespace giga {

/// A small multilayer perceptron as a row of parameters holds it: every layer a matrix [out, in] row by row, and a
/// bias.
struct SmallMlp {
  static constexpr int kMaxLayers = 4;
  static constexpr int kMaxWidth = 128;  ///< of all layers but the input
  int n_layers = 0;
  int width[kMaxLayers + 1] = {};                      ///< input, hidden ..., output
  int weight[kMaxLayers] = {}, bias[kMaxLayers] = {};  ///< first number of each in a row of parameters
  int log_std = 0;                                     ///< first of the three; continuous actions only
  Activation activation = Activation::tanh;
};

/// Who moves one team in a part of the worlds: groups of worlds, each with one network.
struct NetworkGroups {
  const uint16_t* parameters = nullptr;  // [networks, stride] half precision
  const int32_t* network = nullptr;      // [groups] row of parameters; below 0: left out; null: row g
  int groups = 0, worlds_per_group = 0;
  int64_t first_world = 0, group_step = 0, world_step = 0;  // world k of group g: first + g group_step + k world_step
  const float* obs = nullptr;                               // [W, n, obs_stride] of the team, all worlds
  PopulationAct act{};                                      // of all worlds: draws.n agents a world
};

struct PopulationPolicy {
  static constexpr int kMaxParts = 4;
  SmallMlp mlp;
  int64_t parameter_stride = 0;  ///< numbers from one network to the next; a multiple of 8 is read fastest
  int64_t obs_stride = 0;        ///< numbers from one observation to the next; a multiple of 2
  const Phase* phase = nullptr;  // [W] worlds that wait are left out
  NetworkGroups part[kMaxParts];
  int n_parts = 0;
  /// [population_work(policy) + 1] the pieces of work in which a world plays, then their number, as
  /// list_population_work leaves them; null: each launch looks at all.
  const int32_t* work = nullptr;
  int blocks = 0;  ///< of threads that share the pieces, see population_blocks; 0: one for each piece
};

/// Agents of a team that one block can take: a world is not divided.
constexpr int kMaxPopulationTeam = 128;

/// Pieces into which the work of all parts is cut, each for one block of threads.
int population_work(const PopulationPolicy& policy);
/// Twice as many blocks of threads as the GPU holds: enough to even out the work, and few to start where little is
/// left.
int population_blocks(const PopulationPolicy& policy, int index);
/// Queues the listing of the pieces in which a world plays now. The list holds until another world begins to play.
void list_population_work(const PopulationPolicy& policy, int32_t* work, int index, void* stream = nullptr);

/// Queues the actions of all parts. Weights, observations and features are multiplied in half precision, whose mantissa
/// is that of TF32, and added in fp32; a feature beyond 65504 would be infinite.
void launch_population_policy(const PopulationPolicy& policy, int index, void* stream = nullptr);

/// Whether the GPU (compute capability 8.0 or more, enough shared memory), the network and the teams allow it.
bool population_policy_fits(const SmallMlp& mlp, int largest_team, int index);

}  // namespace giga
