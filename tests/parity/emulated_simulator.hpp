// The GPU back end without a GPU: its launches, run on the CPU thread by thread.
#pragma once

#include <memory>

#include "cuda/grid_executor.hpp"
#include "parity/lockstep_threads.hpp"
#include "sim/simulator.hpp"

namespace giga::test {

/// Blocks, threads, shared memory and all that a thread does are those of the GPU back end (cuda/executor.hpp). What
/// lies in shared memory and in scratch is poisoned before it is used. With CompileStep::always the step of an odd
/// scenario (odd_scenarios.hpp) has its constants, as a GPU compiles it.
std::unique_ptr<Simulator> make_emulated_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order);

/// On GPUs of so many blocks a step of worlds of many agents is several launches, where there is a group for each
/// world: as for a million agents; as where half of the blocks are idle; as where there is no room for crews.
constexpr int kBlocksInParts = 8, kBlocksToSpare = 64, kBlocksForMore = 7;

/// The same of worlds of many agents (cuda/grid_executor.hpp), on a GPU of `blocks` blocks of a warp.
std::unique_ptr<Simulator> make_emulated_grid_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order,
                                                        int blocks);

/// The launches of its step.
StepLaunches emulated_launches(SimSpec spec, const SimOptions& options, int blocks);

}  // namespace giga::test
