// Slow tests in full or thinned: CI runs them in full, scripts/test takes an even sample of their cases.
#pragma once

#include <cstdlib>
#include <iostream>

namespace giga::test {

/// GIGASTEP_TEST_FULL=1, which .ci/run sets.
inline bool tests_run_in_full() {
  const char* full = std::getenv("GIGASTEP_TEST_FULL");
  return full && *full && *full != '0';
}

/// The distance of the cases to take: 1 in full, else `stride`; says so.
inline int thinned(int stride) {
  if (tests_run_in_full()) return 1;
  std::cout << "thinned: one case of " << stride << "; all with GIGASTEP_TEST_FULL=1\n";
  return stride;
}

}  // namespace giga::test
