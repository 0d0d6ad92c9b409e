#include "apps/openmp_spin.hpp"

#include <unistd.h>

#include <cstdlib>

#include "apps/own_program.hpp"

namespace giga {

void restart_with_short_spin(char** argv) {
  if (std::getenv("GOMP_SPINCOUNT") || std::getenv("OMP_WAIT_POLICY")) return;
  setenv("GOMP_SPINCOUNT", "4000", 1);
  execv(own_program().c_str(), argv);
}

}  // namespace giga
