// Elementwise operations: a formula applied to every row of some buffers. Each is a plain struct of pointers with
// `operator()(row)`, the same on CPU and GPU; ParallelFor runs it over all rows.
// A row is one agent of one world (or one column of a rollout); R = rows, n = agents of the team.
#pragma once

#include <cstdint>

#include "core/host_device.hpp"
#include "core/philox.hpp"
#include "core/quotient.hpp"

namespace giga {

/// Addresses the draws of a team's agents: row = world * n + slot.
struct RowDraws {
  const uint32_t* draw_step;  // [W] of the simulator's state: fresh numbers every step, kept by checkpoints
  uint64_t seed;
  int64_t first_world;
  int n, team;
  int64_t period = 0;  // as SimOptions::draw_period

  GIGA_HD int64_t world(int64_t row) const { return quotient(row, n); }
  GIGA_HD DrawKey key(int64_t row, uint32_t steps_back = 0) const {
    const int64_t w = world(row);
    return DrawKey(seed, draw_world(first_world, period, w), draw_step[w] - steps_back);
  }
  /// The number of the agent among both teams' agents, for the counter.
  GIGA_HD uint32_t agent(int64_t row) const {
    return draw_slot(static_cast<uint32_t>(row - world(row) * n)) | (static_cast<uint32_t>(team) << 16);
  }
};

/// Maps the rows of a minibatch to rows of the rollout: minibatch state s is state index[s], with n agents each.
struct RowIndex {
  const int64_t* index;  // [states of the minibatch]; null = the identity
  int n;
  GIGA_HD int64_t source(int64_t row) const {
    if (!index) return row;
    const int64_t state = quotient(row, n);
    return index[state] * n + (row - state * n);
  }
};

}  // namespace giga
