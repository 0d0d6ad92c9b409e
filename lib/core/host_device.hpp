// Marks functions that run on the CPU and on the GPU from the same source.
#pragma once

#if defined(__CUDACC__)
#define GIGA_HD __host__ __device__ inline
#else
#define GIGA_HD inline
#endif
