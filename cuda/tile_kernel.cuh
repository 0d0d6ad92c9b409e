// What kernels over worlds are made of on the GPU: its barriers and bulk copies, the thread's place, the blocks that
// tiles are bounded for. For simulator.cu and for the kernel that is compiled at run time (step_compiler.hpp).
#pragma once

#include <type_traits>

#include "cuda/world_threads.hpp"

namespace giga {
namespace {

// Blocks of TileLanes per multiprocessor, which bounds a thread's registers. With the staged rows of teams of five the
// shared memory holds five blocks, of larger teams four. Measured on an H200, G agent-steps/s of 2 vs 2 at 5 and 6
// blocks: 3.83, 4.30; before, at 5 and 8: 3.45, 3.04. Four blocks of five warps leave a thread 96 registers, five 72.
template <class P>
constexpr int kTileBlocks = kBlockIsGroup<P> ? 4
                            : P::kTeam == 2  ? 6
                            : P::kTeam > 0   ? 5
                                             : 8;

// Bulk copies of the tensor memory accelerator, compute capability 9.0 and later.
struct BulkCopies {
#if __CUDA_ARCH__ >= 900
  __device__ void before_sending() const { asm volatile("fence.proxy.async.shared::cta;" ::: "memory"); }
  __device__ void send(float* to, const float* from, int count) const {
    asm volatile("cp.async.bulk.global.shared::cta.bulk_group [%0], [%1], %2;" ::"l"(__cvta_generic_to_global(to)),
                 "r"(static_cast<uint32_t>(__cvta_generic_to_shared(from))),
                 "r"(count * static_cast<int>(sizeof(float)))
                 : "memory");
    asm volatile("cp.async.bulk.commit_group;" ::: "memory");
  }
  __device__ void wait_sent() const { asm volatile("cp.async.bulk.wait_group.read 0;" ::: "memory"); }
  __device__ void wait_delivered() const {
    asm volatile("cp.async.bulk.wait_group 0;" ::: "memory");
    asm volatile("fence.proxy.async.global;" ::: "memory");
  }
#else
  __device__ void before_sending() const {}
  __device__ void send(float* to, const float* from, int count) const {
    for (int k = 0; k < count; k += 4) *reinterpret_cast<float4*>(to + k) = *reinterpret_cast<const float4*>(from + k);
  }
  __device__ void wait_sent() const {}
  __device__ void wait_delivered() const {}
#endif
};
struct WarpSync : BulkCopies {
  __device__ void wait() const { __syncwarp(); }
  __device__ bool any(bool flag) const { return __any_sync(0xFFFFFFFFu, flag); }
};
struct BlockSync : BulkCopies {
  __device__ void wait() const { __syncthreads(); }
  __device__ bool any(bool flag) const { return __syncthreads_or(flag); }
};

/// Of the threads of a group of tiles.
template <class P>
using TileSync = std::conditional_t<kBlockIsGroup<P>, BlockSync, WarpSync>;

__device__ inline ThreadIndex this_thread() {
  return {static_cast<int>(blockIdx.x), static_cast<int>(gridDim.x), static_cast<int>(threadIdx.x),
          static_cast<int>(blockDim.x)};
}

}  // namespace
}  // namespace giga
