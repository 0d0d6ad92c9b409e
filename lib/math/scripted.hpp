// Scripted teams: actions without learning. The first five are the paper's (rules 13.5); docs/scripted_teams.md
// has a table of all.
#pragma once

#include <array>

#include "math/observation_reader.hpp"
#include "math/pilot.hpp"
#include "math/rows.hpp"
#include "math/tactics.hpp"
#include "sim/params.hpp"

namespace giga {

/// The one list of scripts: configs, the command line and messages take their names from here.
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
/// Whether a script looks at the agent's observation.
GIGA_HD bool uses_observation(Scripted script) { return script >= Scripted::pursuer; }

/// Writes the actions of a scripted team.
struct ScriptedActions {
  Scripted kind;
  ActionKind actions;
  RowDraws draws;
  const int32_t* episode_length;  // [W] of the simulator's state
  void* action;                   // [R] int32 or [R, 3] float
  // For scripts that use the observation:
  SimParams params{};
  const float* obs = nullptr;  // [R, obs_stride]
  int obs_stride = 0;

  GIGA_HD void operator()(int64_t row) const { act(kind, row); }
  /// As `script`, whatever `kind` is.
  GIGA_HD void act(Scripted script, int64_t row) const {
    if (uses_observation(script))
      write(row, decide(script, row));
    else
      write_blind(script, row);
  }

 private:
  GIGA_HD Controls decide(Scripted script, int64_t row) const {
    const ObservationReader reader(params, obs + row * obs_stride);
    const Pilot pilot(reader, actions == ActionKind::discrete);
    switch (script) {
      case Scripted::pursuer:
        return pursue(reader, pilot);
      case Scripted::evader:
        return evade(reader, pilot);
      case Scripted::waypoint_runner:
        return run_to_waypoint(reader, pilot);
      case Scripted::hider:
        return hide(reader, pilot);
      default:
        return patrol(reader, pilot);
    }
  }

  GIGA_HD void write(int64_t row, Controls c) const {
    if (actions == ActionKind::discrete) {
      static_cast<int32_t*>(action)[row] = discrete_action(c);
      return;
    }
    float* out = static_cast<float*>(action) + row * kActionSize;
    out[0] = c.heading;
    out[1] = c.dive;
    out[2] = c.throttle;
  }

  /// The paper's scripts.
  GIGA_HD void write_blind(Scripted script, int64_t row) const {
    DrawKey key = draws.key(row);
    if (script == Scripted::random && actions == ActionKind::discrete) {
      const float u = key.uniform(Draw::opponent, draws.agent(row), 0);
      static_cast<int32_t*>(action)[row] = static_cast<int32_t>(u * kNDiscreteActions);
      return;
    }
    Controls c{0, 0, 0};
    if (script == Scripted::circle) c.heading = 1;
    if (script == Scripted::reverse_circle) c.heading = -1;
    if (script == Scripted::circle_random) {
      // The step at which the episode began stands for the episode.
      const uint32_t age = static_cast<uint32_t>(episode_length[draws.world(row)]);
      DrawKey begin = draws.key(row, age);
      c.heading = begin.uniform(Draw::opponent, draws.agent(row), 4) < 0.5f ? 1.0f : -1.0f;
    }
    if (script == Scripted::random) {
      const auto control = [&](uint32_t k) { return 2.0f * key.uniform(Draw::opponent, draws.agent(row), k) - 1.0f; };
      c = {control(0), control(1), control(2)};
    }
    write(row, c);
  }
};

}  // namespace giga
