// PlaySession: one game in which a person flies an agent and scripts or networks fly all others. It is what a page's
// module is made of, and plays natively just the same.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "core/parallel_for.hpp"
#include "game/game.hpp"
#include "play/plain_network.hpp"
#include "scripted/script.hpp"
#include "sim/movement.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// Who flies a team: a script, or a network where there is one.
struct PlayTeam {
  Scripted script = Scripted::noop;
  std::shared_ptr<const PlainNetwork> network = nullptr;
};

class PlaySession {
 public:
  /// The episode of world 0 of a match with this seed, as `gigastep record` plays it. `person`: the agent of a person,
  /// counted over both teams; -1: there is none.
  PlaySession(const SimSpec& spec, uint64_t seed, const PlayTeam& team_0, const PlayTeam& team_1, int person);
  PlaySession(const PlaySession&) = delete;
  PlaySession& operator=(const PlaySession&) = delete;
  ~PlaySession();

  /// One step. `controls` are the person's, each from -1 to 1.
  void step(const Controls& controls);
  bool over() const { return *sim_->state().view().phase == Phase::waits; }

  const SimSpec& spec() const { return sim_->spec(); }
  const SimState& state() const { return sim_->state(); }
  /// What a team did in the last step: int32 or 3 floats an agent.
  const void* actions(int team) const { return actions_[static_cast<size_t>(team)]; }

 private:
  class Actions;

  std::unique_ptr<Simulator> sim_;
  ParallelFor parallel_for_;
  std::shared_ptr<Controls> controls_;
  std::array<const void*, kNTeams> actions_{};
  std::unique_ptr<Actions> watcher_;
  std::unique_ptr<Game> game_;
};

/// A network that moves a team.
std::unique_ptr<TeamController> plain_controller(std::shared_ptr<const PlainNetwork> network);

/// Steps one world of a scenario with random actions, episode after episode, and returns a hash of its states, all
/// fields of each: the same on every machine, in a browser and here.
uint64_t states_hash(const SimSpec& spec, int steps);

}  // namespace giga
