// The kernel of a step that is compiled at run time for one scenario, by NVRTC and by nothing else.
// "cuda/this_scenario.hpp", which step_compiler.cpp writes, has the scenario's constants.
#include "cuda/this_scenario.hpp"
#include "cuda/tile_kernel.cuh"

namespace giga {

using Params = FixedParams<kThisScenario>;

// The host hands over a Launch.
static_assert(sizeof(LaunchOf<Params>) == kLaunchBytes && sizeof(Launch) == kLaunchBytes);

extern "C" __global__ void __launch_bounds__(kTileThreads<Params>, kTileBlocks<Params>)
    fixed_step(const __grid_constant__ LaunchOf<Params> k) {
  extern __shared__ __align__(16) char shared[];
  run_tile_thread<Job::step>(k, this_thread(), shared, TileSync<Params>{});
}

}  // namespace giga
