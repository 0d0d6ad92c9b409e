// Learner: what every training algorithm offers to the program. registry.hpp lists the algorithms.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/memory.hpp"
#include "core/named_array.hpp"
#include "learn/run_config.hpp"
#include "sim/simulator.hpp"

namespace giga {

class Actor;
class GameObserver;
class Player;
class Ranks;

/// Figures of one update, in a stable order: (name, value), NaN = not known.
using Metrics = std::vector<std::pair<std::string, double>>;

/// The first tensor of an update in which a number was a NaN or infinite.
struct Divergence {
  std::string tensor;  ///< "gradient of the critic"
  int team = 0;
  int64_t update = 0;  ///< counted from 1
  int minibatch = 0;   ///< within the update, from 1; 0 = before anything was learned
  /// Of several ranks, which all know the same: those in whose own numbers it is found, before any are added up. None:
  /// in numbers that all share, or in a sum of finite ones.
  std::vector<int> ranks = {};
};

/// Seconds that parts of an update took on the device.
struct UpdateTimes {
  double rollout = 0, learning = 0;
};

/// A figure of a team that is shown while a run goes on.
struct HeadlineFigure {
  const char* label;        ///< "policy loss"
  const char* short_label;  ///< where there is little room; null: not shown there
  const char* metric;       ///< "policy_loss", without the team's number
};

/// Where an update is: "playing", step 12 of 32. `of` 0 = that is not counted.
struct UpdateStage {
  const char* doing = "working";
  int64_t done = 0, of = 0;
};

class Learner {
 public:
  virtual ~Learner() = default;

  /// One update: collect, learn. Queues work on the device and reads back one block of figures at the end. Where
  /// something was not finite, no parameter has changed since, and `divergence` tells.
  virtual Metrics update() = 0;

  /// Of the update that goes on; another thread may ask.
  virtual UpdateStage stage() const { return {}; }

  /// Of the latest update.
  virtual std::optional<Divergence> divergence() const = 0;
  virtual UpdateTimes times() const = 0;
  /// The batch from which a diverged update was to learn, as arrays "batch/...". Several ranks call it together, and
  /// get that of the first of Divergence::ranks, or of rank 0.
  virtual void save_batch(NamedArrays& out) const = 0;

  /// The metrics that are shown while a run goes on, the most telling first.
  virtual std::vector<HeadlineFigure> headline() const = 0;

  /// How it computes where it has several ways: "acts and learns by fused kernels"; empty where there is only one.
  virtual std::string ways() const { return {}; }
  /// What steps its worlds (Simulator::step_way).
  virtual std::string step_way() const { return {}; }
  /// Why the device refused to record steps of its games (Game::refusal), which are queued one by one then; empty: it
  /// did not.
  virtual std::string refusal() const { return {}; }

  virtual int64_t updates_done() const = 0;
  virtual int64_t agent_steps_done() const = 0;

  /// The policy of a team; null where it does not learn.
  virtual Actor* actor(int team) = 0;
  /// The policy that train.opponent names, as it was when the learner was made; null: a script or nobody.
  virtual Player* opponent() { return nullptr; }
  /// What a checkpoint keeps of the critics, for those who look at games; nothing where there are none.
  virtual void save_critics(NamedArrays& /*out*/) const {}

  /// Lets an observer see the games from which the learner learns. It must outlive the learner.
  virtual void watch(GameObserver& observer) = 0;

  /// Everything that the next update depends on.
  virtual void save(NamedArrays& out) const = 0;
  virtual void load(const NamedArrays& in) = 0;
};

/// The learner of the algorithm that `run.config.train.algorithm` names. `ranks`: it shares the games of every update
/// with them, which all make one at the same time, and all have the same state after every update; they must outlive
/// it. Throws InputError where the algorithm or its settings cannot be divided.
std::unique_ptr<Learner> make_learner(const LoadedRun& run, Device device, Ranks* ranks = nullptr);

}  // namespace giga
