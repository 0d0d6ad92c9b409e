// Sobol's points, from LibTorch.
#pragma once

#include <vector>

namespace giga {

/// The first n points of the sequence in [0, 1)^d, one after the other; d is 21201 at most.
std::vector<double> sobol_points(int d, int n);

}  // namespace giga
