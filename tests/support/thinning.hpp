// Slow tests in full or thinned: CI runs them in full, scripts/test takes an even sample of their cases.
#pragma once

#include <cstdlib>
#include <iostream>
#include <string>

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

/// Whether tests of parity are cut, for sanitizers: GIGASTEP_PARITY_SMALL=1, or a build with the address sanitizer.
inline bool parity_is_small() {
#if defined(__SANITIZE_ADDRESS__)
  return true;
#else
  const char* text = std::getenv("GIGASTEP_PARITY_SMALL");
  return text && std::string(text) == "1";
#endif
}

}  // namespace giga::test
