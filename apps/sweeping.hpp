// Trains the trials of a sweep, several at once, each run in a process of its own.
#pragma once

#include "apps/sweep_folder.hpp"

namespace giga {

/// Trains what is left of a sweep, and notes each result in its folder. Runs that failed in an earlier call are tried
/// again, but for those that diverged. With a panel where the errors go to a terminal, else with a line for each run
/// that ends; `quiet`: with neither, but for failures. Returns the exit code: 0 all is done, but where runs failed
/// SweepProgress::failure_code; kOutOfTime its max_wall_time is over, 128 + N stopped by signal N: what went on then is
/// saved.
int train_sweep(SweepFolder& folder, bool quiet);

}  // namespace giga
