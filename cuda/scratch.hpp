// Where the CUDA back end keeps the scratch of a world: in shared memory, or in global memory where it is too large.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/host_device.hpp"
#include "sim/usual_params.hpp"
#include "sim/world.hpp"

namespace giga {

constexpr size_t kSharedLimit = 48 << 10;  // of a block; beyond it a world's scratch lies in global memory

/// Bytes of the working copy of the agents' state and the world's, in front of a world's scratch in shared memory.
GIGA_HD size_t working_copy_bytes(int n_agents) {
  size_t bytes = 0;
  for_each_field([&](auto field, auto member) {
    const StateView fields{};
    if constexpr (field.working) bytes += sizeof(*(fields.*member)) * static_cast<size_t>(field.count(n_agents));
  });
  return (bytes + 3 + 15) & ~size_t{15};  // 3: the world's words begin at a whole one behind the agents' bytes
}

/// Bytes of shared memory that a world takes in a step, or in another job, where its scratch lies there. Where a warp
/// has several worlds, the same array of those side by side lies 12 or 20 words further in each: so lanes of three
/// worlds of ten agents meet in a bank twice at most, and those of eight worlds of four never. (Shared memory has 32
/// banks of a word each.)
template <bool kStep>
size_t shared_bytes(const SimParams& p) {
  size_t bytes = working_copy_bytes(p.n_agents);
  with_usual_params<kStep>(p, [&](const auto& q) { bytes += ScratchLayout(q).size; });
  while (p.n_agents <= 32 && bytes % 128 != 48 && bytes % 128 != 80) bytes += 16;
  return bytes;
}

/// Bytes of global memory for the scratch of `n_worlds` worlds; 0 = shared memory holds it.
inline size_t global_scratch_bytes(const SimParams& p, int64_t n_worlds) {
  return shared_bytes<false>(p) > kSharedLimit ? ScratchLayout(p).size * static_cast<size_t>(n_worlds) : 0;
}

}  // namespace giga
