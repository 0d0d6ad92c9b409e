// How long waiting OpenMP threads spin before they sleep.
#pragma once

namespace giga {

/// Starts the program anew with GOMP_SPINCOUNT set, unless it or OMP_WAIT_POLICY is. GCC's OpenMP reads the variable
/// when it is loaded, long before main. With its default, threads spin for milliseconds; where other programs want the
/// same cores, nobody makes progress: training took 4 s short, 16 s by default, and more than 60 s by default beside
/// one busy process (quickstart, 1 M agent-steps, two cores). Returns where there is nothing to do, or where starting
/// fails.
void restart_with_short_spin(char** argv);

}  // namespace giga
