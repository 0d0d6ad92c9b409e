// Scripted: the one list of scripts, teams that play by a rule; docs/scripted_teams.md has a table of all.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "core/host_device.hpp"
#include "sim/observation.hpp"

namespace giga {

/// Configs, the command line and messages take the names from here. The page docs/rules.md has more on them (13.5).
enum class Scripted : uint8_t {
  random,           ///< uniform over the 27 actions, or over [-1, 1)^3
  noop,             ///< straight on
  circle,           ///< turns left for ever: a stable orbit
  reverse_circle,   ///< turns right
  circle_random,    ///< left or right, drawn per agent and episode
  pursuer,          ///< turns to the nearest enemy that it sees, and searches while it sees none
  evader,           ///< flies away from the enemies that it sees
  waypoint_runner,  ///< flies to the waypoint
  hider,            ///< keeps behind an obstacle or in the far corner
  patroller,        ///< flies round the map
};
constexpr std::array<const char*, 10> enum_names(Scripted) {
  return {"random",  "noop",   "circle",          "reverse_circle", "circle_random",
          "pursuer", "evader", "waypoint_runner", "hider",          "patroller"};
}
constexpr const char* name_of(Scripted script) { return enum_names(script)[static_cast<size_t>(script)]; }
/// Whether a script looks at the agent's observation: those from pursuer on.
GIGA_HD bool uses_observation(Scripted script) { return script >= Scripted::pursuer; }
/// The observations that it looks at.
constexpr ObservationSet observations_of(Scripted script) {
  return script >= Scripted::pursuer ? Observation::vector : ObservationSet();
}

/// Where networks are told by their rows: a script among them is -1 - its number.
GIGA_HD Scripted script_of_network(int32_t network) { return static_cast<Scripted>(-1 - network); }
constexpr int32_t network_of_script(Scripted script) { return -1 - static_cast<int32_t>(script); }

}  // namespace giga
