// Marks functions that run on the CPU and on the GPU from the same source.
#pragma once

#if defined(__CUDACC__)
#define GIGA_HD __host__ __device__ inline
#else
#define GIGA_HD inline
#endif

// In front of a loop over a small array that must stay in registers on the GPU; and of one that must not grow the code.
#if defined(__CUDA_ARCH__)
#define GIGA_UNROLL _Pragma("unroll")
#define GIGA_ROLLED _Pragma("unroll 1")
#define GIGA_UNROLL_BY_4 _Pragma("unroll 4")
#else
#define GIGA_UNROLL
#define GIGA_ROLLED
#define GIGA_UNROLL_BY_4
#endif

namespace giga {

/// A number of a table that does not change while a kernel runs. The GPU may read it early and keep it, which it may
/// not do with what lies in memory that is written.
template <class T>
GIGA_HD T table_value(const T* p) {
#if defined(__CUDA_ARCH__)
  return __ldg(p);
#else
  return *p;
#endif
}

/// On a GPU: has the memory at an address brought to its caches, without waiting for it.
GIGA_HD void prefetch([[maybe_unused]] const void* p) {
#if defined(__CUDA_ARCH__)
#if !defined(GIGA_PF) || GIGA_PF == 1
  asm volatile("prefetch.global.L1 [%0];" ::"l"(p));
#elif GIGA_PF == 2
  asm volatile("prefetch.global.L2 [%0];" ::"l"(p));
#endif
#endif
}

}  // namespace giga
