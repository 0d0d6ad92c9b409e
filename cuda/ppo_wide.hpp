// The fused gradients of networks with a hidden layer of 129 to 256 numbers, on local observations: what
// launch_actor_gradient() and launch_critic_gradient() queue for them.
//
// Neither the weights of such a network and their gradients nor what lies between its layers fit in a multiprocessor
// together, so one kernel follows the other, each with one large weight in shared memory, and between them lie features
// and gradients in global memory, in half precision:
//   first layer      rows -> inputs x, features h1; composed critics also: their mean over each state
//   team product     means -> what they add to the second layer's sums, the same for all rows of a state (composed
//                    critics)
//   second layer     h1 -> features, loss, its gradient by the sums of the second layer: d2; the last layer's gradient
//   team product     sums of d2 over each state -> what its living agents add to their d1 (composed critics)
//   weight gradient  d2^T h1, of the team weight as well; the second bias
//   back             d2, the slopes of h1 -> d1, in the place of h1; or, with few inputs, what follows
//   weight gradient  d1^T x; the first bias
//   sums             over the parts of all blocks
#pragma once

#include <algorithm>

#include "cuda/ppo_gradients.hpp"

namespace giga {

/// What lies between the kernels, of a number of tiles with 64 rows each: whole states, and rows at the end that belong
/// to no state. Numbers of hidden layers lie in the order of wide_place().
struct WideLayers {
  static constexpr int kTileRows = 64, kWidth = FusedMlp::kHidden;

  uint32_t* hidden1 = nullptr;  // [tiles 64, 128 pairs] features of the first layer; then d1
  uint32_t* d2 = nullptr;       // [tiles 64, 128]
  uint32_t* slopes1 = nullptr;  // [tiles 64, 128] of h1; null: they follow from h1
  uint32_t* inputs = nullptr;   // [tiles 64, padded_input / 2]
  float* share = nullptr;       // [tiles 64] of a state's mean: 1 / its living agents; 0: dead, or no row
  uint32_t* means = nullptr;    // [tiles states, 128] of h1; null: no team weights
  uint32_t* d2_sums = nullptr;  // [tiles states, 128]
  uint32_t* of_team = nullptr;  // [tiles states, 128] what a team product leaves
  float* parts = nullptr;       // [parts, size + kFusedSums] of each block
  float* unscale = nullptr;     // [1] gradients are 1 / unscale times too large
  int64_t tiles = 0;            // that there is room for
  int states = 0;               // of a tile
  int64_t words = 0;            // of all this

  WideLayers() = default;
  /// At `memory`; null: only `words` counts. No parts: for values alone.
  WideLayers(const FusedMlp& net, int n, int64_t tiles_, int n_parts, uint32_t* memory)
      : tiles(tiles_), states(kTileRows / n) {
    const auto take = [&](int64_t count) {
      uint32_t* at = memory ? memory + words : nullptr;
      words += (count + 63) / 64 * 64;
      return at;
    };
    const int64_t rows = tiles * kTileRows, all_states = tiles * states;
    hidden1 = take(rows * kWidth / 2);
    share = reinterpret_cast<float*>(take(rows));
    if (net.team_weight[1] >= 0) {
      means = take(all_states * kWidth / 2);
      of_team = take(all_states * kWidth / 2);
    }
    if (n_parts == 0) return;
    d2 = take(rows * kWidth / 2);
    if (net.activation != Activation::tanh && net.activation != Activation::relu) slopes1 = take(rows * kWidth / 2);
    inputs = take(rows * padded_input(net) / 2);
    if (net.team_weight[1] >= 0) d2_sums = take(all_states * kWidth / 2);
    parts = reinterpret_cast<float*>(take(n_parts * (net.size + kFusedSums)));
    unscale = reinterpret_cast<float*>(take(1));
  }
  static int padded_input(const FusedMlp& net) { return (net.width[0] + 63) / 64 * 64; }
  static int64_t tiles_of(int n, int64_t n_states) {
    const int states = kTileRows / n;
    return (n_states + states - 1) / states;
  }
  /// Words for the gradients of so many states; 0: the network is not wide.
  static int64_t words_for(const FusedMlp& net, int n, int64_t n_states, int n_parts) {
    return net.is_wide() ? WideLayers(net, n, tiles_of(n, n_states), n_parts, nullptr).words : 0;
  }
  /// Words for the values of so many tiles, and the tiles that so many words have room for.
  static int64_t words_for_values(const FusedMlp& net, int n, int64_t tiles) {
    return net.is_wide() ? WideLayers(net, n, tiles, 0, nullptr).words : 0;
  }
  static int64_t tiles_for_values(const FusedMlp& net, int n, int64_t words) {
    return net.is_wide() ? words / words_for_values(net, n, 1) : 0;
  }
};

/// Where column `c` of a hidden layer lies among its 256 numbers; it is its own inverse, so also which column lies at
/// place c. Of 32 columns a lane holds two of each eight, which lie side by side there.
GIGA_HD constexpr int wide_place(int c) { return (c & ~30) | (c & 6) << 2 | (c & 24) >> 2; }
static_assert(wide_place(2) == 8 && wide_place(8) == 2 && wide_place(24 + 1) == 7);

/// Some tiles of a minibatch, or of all rows whose values are asked for.
struct WidePiece {
  WideLayers layers;
  int64_t first = 0, count = 0;
};
struct WideFirst {
  FusedMlp net{};
  const float* parameters = nullptr;
  FusedRows rows{};
  WidePiece piece;
};
/// from [rows, 256] -> to [rows, 256] by the second team weight: of means on the way forward, else of sums.
struct WideTeamProduct {
  FusedMlp net{};
  const float* parameters = nullptr;
  const uint32_t* from = nullptr;
  uint32_t* to = nullptr;
  int64_t rows = 0;
  bool forward = true;
};
struct WideActor {
  FusedActor of;  // whose `partial` are the parts
  WidePiece piece;
};
struct WideCritic {
  FusedCritic of;
  WidePiece piece;
};
/// Of networks with few inputs d1 need not leave the chip: the first weight's gradient is made of it at once.
struct WideBack {
  static constexpr int kFewInputs = 64;
  FusedMlp net{};
  const float* parameters = nullptr;
  int n = 0;  // agents of the team
  WidePiece piece;
  bool few_inputs() const { return net.width[0] <= kFewInputs; }
};
/// A weight's gradient, outer^T inner, and that of a bias, the column sums of `outer`, both times `unscale`. Of weights
/// with more numbers than the registers of a block have room for, every second block computes the first 128 rows; so
/// half as many parts have them.
struct WideWeight {
  const uint32_t* outer = nullptr;  // [rows, 256] halves
  const uint32_t* inner = nullptr;  // [rows, 256], or inputs [rows, padded]
  int64_t rows = 0;
  int out = 0, in = 0;            // of the weight
  int inner_width = 0;            // numbers of a row of `inner`: 128 or 192 inputs; or 256 of a hidden layer
  int64_t weight = 0, bias = -1;  // first number of each in a part; -1: no bias
  float* parts = nullptr;         // [parts, stride] out
  int64_t stride = 0;
  const float* unscale = nullptr;
  static constexpr int kMostWhole = 128;
  /// Whether a block has half of the rows.
  bool halved() const { return inner_width > kMostWhole; }
  int parts_of(int n_parts) const { return halved() && n_parts > 1 ? n_parts / 2 : n_parts; }
  int blocks(int n_parts) const { return (halved() ? 2 : 1) * parts_of(n_parts); }
};
/// to[column] = the sum over all parts that have it.
struct WideSums {
  static constexpr int kColumns = 32;  // of a block
  static constexpr int kMostRanges = 6;
  const float* parts = nullptr;
  int n_parts = 0;
  int64_t stride = 0;
  float* to = nullptr;
  int n_ranges = 0;  // ranges of columns that fewer parts have
  int64_t first[kMostRanges] = {}, end[kMostRanges] = {};
  int parts_of_range[kMostRanges] = {};
  GIGA_HD int parts_of(int64_t column) const {
    for (int k = 0; k < n_ranges; ++k)
      if (column >= first[k] && column < end[k]) return parts_of_range[k];
    return n_parts;
  }
  void add(const WideWeight& w) {
    const auto range = [&](int64_t from, int64_t count) {
      first[n_ranges] = from;
      end[n_ranges] = from + count;
      parts_of_range[n_ranges++] = w.parts_of(n_parts);
    };
    range(w.weight, int64_t{w.out} * w.in);
    if (w.bias >= 0) range(w.bias, w.out);
  }
  int blocks() const { return static_cast<int>((stride + kColumns - 1) / kColumns); }
};

// What follows what. `queue` is called with each of the structures above in turn.

/// The gradients that `d2` and what lies before it leave, from the second layer's on.
template <class Pass, class Queue>
void queue_wide_gradients(const Pass& pass, const WidePiece& piece, Queue&& queue) {
  const FusedMlp& net = pass.net;
  const WideLayers& l = piece.layers;
  const int64_t stride = net.size + kFusedSums, rows = piece.count * WideLayers::kTileRows;
  WideSums sums{.parts = l.parts, .n_parts = pass.n_partial, .stride = stride, .to = pass.partial};
  const auto weight = [&](const WideWeight& w) {
    sums.add(w);
    queue(w);
  };
  const WideWeight second{.outer = l.d2,
                          .inner = l.hidden1,
                          .rows = rows,
                          .out = net.width[2],
                          .in = net.width[1],
                          .inner_width = WideLayers::kWidth,
                          .weight = net.weight[1],
                          .bias = net.bias[1],
                          .parts = l.parts,
                          .stride = stride,
                          .unscale = l.unscale};
  weight(second);
  if (l.means) {
    const int64_t states = piece.count * l.states;
    WideWeight team = second;
    team.outer = l.d2_sums;
    team.inner = l.means;
    team.rows = states;
    team.weight = net.team_weight[1];
    team.bias = -1;
    weight(team);
    queue(WideTeamProduct{net, pass.parameters, l.d2_sums, l.of_team, states, false});
  }
  const WideBack back{net, pass.parameters, pass.rows.n, piece};
  queue(back);
  WideWeight first = second;
  first.outer = l.hidden1;
  first.inner = l.inputs;
  first.out = net.width[1];
  first.in = net.width[0];
  first.inner_width = WideLayers::padded_input(net);
  first.weight = net.weight[0];
  first.bias = net.bias[0];
  if (!back.few_inputs()) weight(first);
  queue(sums);
}

template <class Queue>
void queue_wide_actor(const FusedActor& actor, Queue&& queue) {
  const int64_t tiles = WideLayers::tiles_of(actor.rows.n, actor.rows.n_states);
  const WidePiece piece{WideLayers(actor.net, actor.rows.n, tiles, actor.n_partial, actor.wide), 0, tiles};
  queue(WideFirst{actor.net, actor.parameters, actor.rows, piece});
  WideActor second{actor, piece};
  second.of.partial = piece.layers.parts;
  queue(second);
  queue_wide_gradients(actor, piece, queue);
}

/// Values are computed piece by piece, as many tiles at once as the memory has room for.
template <class Queue>
void queue_wide_critic(const FusedCritic& critic, Queue&& queue) {
  const bool team = critic.net.team_weight[1] >= 0;
  const int n = critic.rows.n;
  const int64_t tiles = WideLayers::tiles_of(n, critic.rows.n_states);
  const auto forward = [&](const WidePiece& piece) {
    queue(WideFirst{critic.net, critic.parameters, critic.rows, piece});
    if (team)
      queue(WideTeamProduct{critic.net, critic.parameters, piece.layers.means, piece.layers.of_team,
                            piece.count * piece.layers.states, true});
    WideCritic second{critic, piece};
    second.of.partial = piece.layers.parts;
    queue(second);
  };
  if (!critic.values) {
    const WidePiece all{WideLayers(critic.net, n, tiles, critic.n_partial, critic.wide), 0, tiles};
    forward(all);
    return queue_wide_gradients(critic, all, queue);
  }
  const int64_t at_once = std::min(tiles, critic.wide_tiles);
  const WideLayers layers(critic.net, n, at_once, 0, critic.wide);
  for (int64_t first = 0; first < tiles; first += at_once) forward({layers, first, std::min(at_once, tiles - first)});
}

/// On the current GPU.
void launch_wide_actor_gradient(const FusedActor& actor, void* stream);
void launch_wide_critic_gradient(const FusedCritic& critic, void* stream);

// Each kernel.
void launch_wide(const WideFirst& first, int blocks, void* stream);
void launch_wide(const WideTeamProduct& product, int blocks, void* stream);
void launch_wide(const WideActor& second, int blocks, void* stream);
void launch_wide(const WideCritic& second, int blocks, void* stream);
void launch_wide(const WideWeight& weight, int blocks, void* stream);
void launch_wide(const WideBack& back, int blocks, void* stream);
void launch_wide(const WideSums& sums, int blocks, void* stream);

}  // namespace giga
