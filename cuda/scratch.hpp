// Where the CUDA back end keeps the scratch of a world: in shared memory, or in global memory where it is too large.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/world_threads.hpp"
#include "sim/usual_params.hpp"

namespace giga {

constexpr size_t kSharedLimit = 48 << 10;  // of a block; beyond it a world's scratch lies in global memory
/// Of a block whose worlds are tiles in a step, which asks for it: every GPU since Turing has it. 20 against 20 with
/// the egocentric view take 50,624 bytes, 15 against 15 up to 55,920.
constexpr size_t kStepSharedLimit = 64 << 10;

/// Bytes of shared memory that a world takes, where its scratch of that layout lies there. Where a warp has several
/// worlds, the same array of those side by side lies 12 or 20 words further in each: so lanes of three worlds of ten
/// agents meet in a bank twice at most, and those of eight worlds of four never. (Shared memory has 32 banks of a word
/// each.)
inline size_t shared_bytes(int n_agents, const ScratchLayout& layout) {
  size_t bytes = working_copy_bytes(n_agents) + layout.size;
  while (n_agents <= 32 && bytes % 128 != 48 && bytes % 128 != 80) bytes += 16;
  return bytes;
}

/// The same in a step, or in another job.
template <bool kStep>
size_t shared_bytes(const SimParams& p) {
  size_t bytes = 0;
  with_usual_params<kStep>(p, [&](const auto& q) { bytes = shared_bytes(p.n_agents, ScratchLayout(q)); });
  return bytes;
}

/// Bytes of global memory for the scratch of `n_worlds` worlds; 0 = shared memory holds it.
inline size_t global_scratch_bytes(const SimParams& p, int64_t n_worlds) {
  return shared_bytes<false>(p) > kSharedLimit ? ScratchLayout(p).size * static_cast<size_t>(n_worlds) : 0;
}

}  // namespace giga
