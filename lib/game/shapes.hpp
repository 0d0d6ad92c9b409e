// Shapes of buffers: of those that a game has of its own, which the memory plan counts too.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/params.hpp"
#include "sim/row_layout.hpp"

namespace giga {

/// An array; without sides it is not allocated.
struct BufferShape {
  ElementType type = ElementType::f32;
  std::vector<int64_t> sides;

  bool exists() const { return !sides.empty(); }
  int64_t elements() const {
    int64_t count = exists() ? 1 : 0;
    for (const int64_t side : sides) count *= side;
    return count;
  }
  int64_t bytes() const { return elements() * (size_of(type)); }
};

/// Buffers of one team in a game of `n_worlds` worlds.
struct GameShapes {
  BufferShape action;  ///< [W, n] int32 or [W, n, 3] float
  BufferShape obs;     ///< [W, n, D] of a team whose controller looks
};
inline GameShapes game_shapes(const SimSpec& spec, int team, int64_t n_worlds, bool looks) {
  const int64_t n = spec.params.n_team[team];
  GameShapes shapes;
  if (spec.params.actions == ActionKind::discrete)
    shapes.action = {ElementType::i32, {n_worlds, n}};
  else
    shapes.action = {ElementType::f32, {n_worlds, n, kActionSize}};
  if (looks) shapes.obs = {ElementType::f32, {n_worlds, n, observation_rows(spec).stride()}};
  return shapes;
}

}  // namespace giga
