// The GPU back end without a GPU: its launches, run on the CPU thread by thread.
#pragma once

#include <memory>

#include "parity/lockstep_threads.hpp"
#include "sim/simulator.hpp"

namespace giga::test {

/// Blocks, threads, shared memory and all that a thread does are those of the GPU back end (cuda/executor.hpp). What
/// lies in shared memory and in scratch is poisoned before it is used.
std::unique_ptr<Simulator> make_emulated_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order);

}  // namespace giga::test
