// Compiles the step of one scenario at run time, with all that decides about its loops and branches as constants
// (sim/fixed_params.hpp). It is the same code as that of the general kernel, with the same flags: the same numbers.
#pragma once

#include <string>

#include "cuda/kernel_cache.hpp"
#include "cuda/nvrtc.hpp"
#include "sim/params.hpp"

namespace giga {

/// Agents of a world up to which its step is compiled: as many as usual kernels have. Those of more have no registers
/// left for all that is known of them at once.
constexpr int kMostFixedAgents = 40;
constexpr int kMostFixedTeam = 32;                    ///< and agents of a team: a word has a bit for each
constexpr const char* kFixedStepName = "fixed_step";  ///< of the kernel

/// Why the step of a scenario is not compiled for it; empty: it can be.
std::string why_no_fixed_step(const SimParams& p);

/// "cuda/this_scenario.hpp": the constants of a scenario.
std::string this_scenario(const SimParams& p);
/// All that is compiled for a scenario, for GPUs of a compute capability, as 90.
NvrtcProgram step_program(const SimParams& p, int compute_capability);

struct CompiledStep {
  std::string code;    ///< for the GPU; empty where there is none
  std::string report;  ///< how it was come by, or why there is none: "compiled in 6.2 s"
  bool cached = false;
};
/// From the cache, else compiled and kept there; `anew`: compiled in any case.
CompiledStep compile_step(const SimParams& p, int compute_capability, const Nvrtc& nvrtc, const KernelCache& cache,
                          bool anew = false);

}  // namespace giga
