// Game: the only loop that plays games. A game has a simulator, a controller for each team or for parts of it, and
// observers, who get the buffers of each step.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "game/team_controller.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// Who moves a team in which worlds. The parts of a side are all worlds, in their order.
struct SidePart {
  std::shared_ptr<TeamController> controller;
  WorldRange worlds;
};
using Side = std::vector<SidePart>;
using BothSides = std::array<Side, kNTeams>;  // by team
/// Numbers that each agent of a side remembers (TeamController::memory_size).
int64_t memory_size(const Side& side);
/// One controller in all worlds.
inline Side everywhere(std::shared_ptr<TeamController> controller, const Simulator& sim) {
  return {{std::move(controller), {0, sim.n_worlds()}}};
}

/// Where one step of all worlds reads and writes.
struct GameStep {
  /// Rows of observations of a team's agents [W, n, D], as observation_rows() lays them out.
  struct Rows {
    float *obs = nullptr, *final_obs = nullptr;
    ObservationSet wanted = {};  ///< written in all worlds, besides those that controllers read where they play
  };
  const Simulator* sim = nullptr;  ///< that plays
  StepIo io;                  ///< of the simulator; its actions are those of `team`, its observations those of `rows`
  TeamBuffers team[kNTeams];  ///< of the controllers
  Rows rows[kNTeams];         ///< that the step writes
};

/// How an observer asks for a buffer: where an observer before it has brought one, both read that one.
template <class T>
void want(T*& buffer, std::type_identity_t<T>* own) {
  if (!buffer) buffer = own;
}

/// Whoever wants something of a game: learners, benchmarks, recorders.
class GameObserver {
 public:
  virtual ~GameObserver() = default;

  virtual void before_play(int64_t /*n_steps*/) {}
  /// Before step `t` of a play; -1: before the first observations are written. Adds what it wants of the step by
  /// want() and to Rows::wanted, and takes nothing away that others want. It must do nothing else: steps may be asked
  /// for ahead of time. Actions and observations for which nobody brings a buffer lie in buffers of the game. Images
  /// are wanted by Rows::wanted too, and found in `io`; one buffer serves all steps.
  virtual void before_step(int64_t /*t*/, GameStep& /*step*/) {}
  /// When the step is queued. The buffers that it wanted, its own or others', are those of `step`. What this and
  /// record_step queue writes nothing that a controller keeps: controllers may read that before it has ended
  /// (TeamStep::behind_step).
  virtual void after_step(int64_t /*t*/, const GameStep& /*step*/) {}

  /// Whether it reads the tables of pairs of the state, which are kept then where the options leave that open.
  virtual bool needs_tables() const { return false; }

  /// Whether steps may be recorded although it observes them (TeamController::repeats). Then `before_step` asks the
  /// same at each, and steps that are recorded are told by the two below in the place of after_step.
  virtual bool repeats() const { return false; }
  /// While kListPeriod steps are recorded: queues nothing but kernels on the simulator's stream, which run whenever
  /// step `k` of them has.
  virtual void record_step(int /*k*/, const GameStep& /*step*/) {}
  /// When the kListPeriod steps that were recorded are queued once more.
  virtual void after_recorded(const GameStep& /*step*/) {}

  /// Whether plays of as many steps are alike: `before_step` asks the same at each step of one as at that of the other,
  /// and after_step has nothing to do. Then plays of worlds that never wait are recorded whole.
  virtual bool repeats_plays() const { return false; }
};

class Game {
 public:
  /// The simulator, `parallel_for` and the observers must outlive the game. A controller that has several parts is
  /// asked once a step for all of them.
  Game(Simulator& sim, const ParallelFor& parallel_for, const BothSides& sides,
       std::vector<GameObserver*> observers = {});
  ~Game();

  /// Before `start` and `resume`: in half of the worlds of a team, networks that read nothing but the egocentric view
  /// see and act in the mirror (TeamIo::mirrored). Team 0 in those whose number is odd, team 1 in those where half of
  /// it is, so that all four cases are met; the number is that among all ranks' worlds.
  void mirror_half() { mirrors_half_ = true; }

  /// Starts the first episode of each world.
  void start();
  /// Goes on from the simulator's state, after one was loaded, or after any step of another game.
  void resume();
  /// After `start`: lets first episodes begin at a random age, so that worlds do not reset in step.
  void desynchronize();

  /// Adds an observer, which comes after the others.
  void watch(GameObserver& observer);

  /// Queues `n_steps` steps, or fewer where all worlds wait before. The host waits for none of them, except with
  /// OnDone::freeze: there it waits for steps of some time ago, to learn whether a world still plays (Simulator::over).
  /// Where all controllers and observers repeat themselves, steps are recorded, as far as the back end can
  /// (Simulator::record), and then queued in one call: kListPeriod steps of such a game, and of one whose worlds never
  /// wait a whole play, once one of as many steps has been queued step by step. They are the same steps.
  void play(int64_t n_steps);
  /// Why the device refused to record steps, which were queued one by one then; empty: it did not.
  const std::string& refusal() const { return refusal_; }

 private:
  struct Part {
    int team;
    WorldRange worlds;
  };
  struct Seat {
    std::shared_ptr<TeamController> controller;
    std::vector<Part> parts;
  };
  void take_seats(const Side& side, int team);
  void make_buffers();
  void find_readers();
  GameStep ask(int64_t t) const;
  GameStep step_at(int64_t t) const;
  GameStep begin(void (Simulator::*write)(const StepIo&));
  void finish(int64_t t, const GameStep& step);
  void act(const GameStep& step, bool behind_step);
  /// What a controller is asked to move.
  std::span<const TeamStep> parts_of(const Seat& seat, const GameStep& step, int64_t number, bool behind_step,
                                     const ParallelFor& parallel_for);
  bool controllers_repeat(bool (TeamController::*alike)() const) const;
  bool repeats() const;
  bool repeats_plays(int64_t n_steps) const;
  bool queue_play(int64_t n_steps);
  bool queue_period(int64_t t);
  void record_period(int64_t t);
  std::unique_ptr<RecordedWork> record(int64_t n_steps, const std::function<GameStep(int64_t k)>& step,
                                       const std::function<void(int64_t k)>& recorded);
  void forget(const GameStep& step);

  Simulator& sim_;
  const ParallelFor& parallel_for_;
  std::vector<Seat> seats_;
  std::vector<GameObserver*> observers_;
  const RowLayout layout_;
  ObservationSet reads_[kNTeams];  // of the controllers of a side
  /// A number for each world, [W] where worlds differ, else none.
  struct PerWorld {
    std::vector<uint8_t> numbers;
    Buffer<uint8_t> buffer;  // the same on the device

    void set(Simulator& sim, std::vector<uint8_t> wanted);
    const uint8_t* data() const { return numbers.empty() ? nullptr : buffer.data(); }
  };
  PerWorld readers_[kNTeams];        // TeamIo::reads
  ObservationSet watched_[kNTeams];  // what observers wanted when readers_ was made
  PerWorld mirrored_[kNTeams];       // TeamIo::mirrored
  bool mirrors_half_ = false;
  Buffer<float> obs_[kNTeams], action_[kNTeams];  // empty where observers have them
  Buffer<uint8_t> image_[kNTeams];                // [W, n, R, R, 3] of the agents; empty where nobody wants them
  Buffer<float> memory_[kNTeams];                 // [W, n, S]; likewise
  int64_t memory_size_[kNTeams] = {};             // S
  const float* seen_[kNTeams] = {};               // the observations that were written last
  const uint8_t* seen_image_[kNTeams] = {};       // and the images
  int64_t steps_ = 0;                             // since the start
  bool started_ = false;
  std::vector<TeamStep> parts_;           // of the controller that acts
  std::unique_ptr<RecordedWork> period_;  // the steps of a period of this play
  GameStep period_step_;                  // each of them
  std::unique_ptr<RecordedWork> play_;    // all steps of a play
  GameStep play_step_;                    // the last of them
  int64_t played_ = 0;                    // steps of the latest play, which the next one may be like; 0: it is not
  std::string refusal_;
};

}  // namespace giga
