// ScriptedActions: the actions of a team that a script moves, the same on CPU and GPU.
#pragma once

#include "math/rows.hpp"
#include "scripted/observation_reader.hpp"
#include "scripted/pilot.hpp"
#include "scripted/script.hpp"
#include "scripted/tactics.hpp"
#include "sim/params.hpp"

namespace giga {

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
  /// Where `kind` does not look at observations: less code.
  GIGA_HD void act_blind(int64_t row) const { write_blind(kind, row); }

 private:
  GIGA_HD Controls decide(Scripted script, int64_t row) const {
    const ObservationReader reader(params, obs + row * obs_stride);
    const Pilot pilot(reader, actions == ActionKind::discrete);
    return pilot.fly(course(script, reader, pilot));
  }
  GIGA_HD static Course course(Scripted script, const ObservationReader& reader, const Pilot& pilot) {
    switch (script) {
      case Scripted::pursuer:
        return pursue(reader, pilot);
      case Scripted::evader:
        return evade(reader, pilot);
      case Scripted::waypoint_runner:
        return run_to_waypoint(reader, pilot);
      case Scripted::hider:
        return hide(reader, pilot);
      case Scripted::patroller:
        return patrol(reader, pilot);
      // Those of write_blind. There is no default: a script that stands in neither list does not compile.
      case Scripted::random:
      case Scripted::noop:
      case Scripted::circle:
      case Scripted::reverse_circle:
      case Scripted::circle_random:
        break;
    }
    return {};
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

/// The actions of two teams, or of parts of them, whose scripts do not look at observations: one loop over the rows of
/// both, because on a GPU the launches of such short work take longer than the work.
struct BlindActions {
  ScriptedActions first, second;
  int64_t n_first;  // rows

  GIGA_HD void operator()(int64_t row) const {
    if (row < n_first)
      first.act_blind(row);
    else
      second.act_blind(row - n_first);
  }
};

}  // namespace giga
