// In the place of lib/sim/grid_simulator.cpp in the module of pages, which play worlds of few agents alone.
#include "core/error.hpp"
#include "sim/simulator.hpp"

namespace giga {

std::unique_ptr<Simulator> make_grid_simulator(SimSpec spec, const SimOptions&) {
  throw Error(cat("a page does not play worlds of ", spec.params.n_agents, " agents"));
}

}  // namespace giga
