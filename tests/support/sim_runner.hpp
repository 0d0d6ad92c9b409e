// SimRunner: a simulator of any back end with all its buffers, poisoned before every step; snapshots and their
// comparison bit for bit.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim/simulator.hpp"

namespace giga::test {

/// One array of a snapshot: [world][agent or 1][...].
struct SnapshotField {
  std::string name;
  std::vector<uint8_t> bytes;
  size_t per_world = 1, per_agent = 1;  ///< elements
  size_t element = 1;                   ///< bytes
  bool is_float = false;
  bool observed = false;  ///< Simulator::observe writes it
};

/// State and outputs of all worlds after a start or a step, on the host.
struct Snapshot {
  size_t n_worlds = 0;
  std::vector<SnapshotField> fields;
  const SnapshotField& field(const std::string& name) const;
  float float_at(const std::string& name, size_t index) const;
  uint8_t byte_at(const std::string& name, size_t index) const { return field(name).bytes[index]; }
};

/// What Simulator::observe writes: observations, alive flags and the true state.
Snapshot observations(const Snapshot& snapshot);

/// Of the worlds that play in `before`: replaces their observations in `kept` by those of `after`.
void keep_observations(Snapshot& kept, const Snapshot& before, const Snapshot& after);

/// Empty if all bits are equal; else the first differing fields with world, agent, index and both values.
std::string difference(const Snapshot& expected, const Snapshot& actual);

/// Random actions of a team: controls a little beyond [-1, 1], or indices -1 to 27, as bytes of its action buffer.
std::vector<uint8_t> random_actions(const SimSpec& spec, int team, int n_worlds, uint64_t seed);

/// Which outputs a runner asks for; `observations` and `egocentric` as populations do, who leave waiting worlds out of
/// a step. `by_world`: observations of which each world and team has others read (TeamIo::reads); the rows of the rest
/// stay poisoned. `in_mirror`: the same, and each team in some of the worlds in the mirror (TeamIo::mirrored).
enum class Outputs { all, observations, egocentric, by_world, in_mirror, none };

class SimRunner {
 public:
  static constexpr uint8_t kPoison = 0xFF;
  /// `row_step`: from one row of observations to the next it is the next larger multiple of this; 0 = rows are dense.
  /// What lies between is poisoned and nobody may touch it, or with kZerosBehind zero, as RowLayout has it.
  static constexpr int kZerosBehind = 8;
  explicit SimRunner(std::unique_ptr<Simulator> sim, Outputs outputs = Outputs::all, int row_step = 0);

  Simulator& sim() { return *sim_; }
  void start();
  /// A step with random actions, the same for the same seed on every back end.
  void step(uint64_t action_seed);
  /// A step by the actions of the last one, queued without the count that Simulator::begin_steps makes; and recorded;
  /// null where the back end records nothing.
  void queue_step();
  std::unique_ptr<RecordedWork> record_step();
  /// Writes the observations once more; the other outputs are left poisoned.
  void observe();
  /// The state, then the outputs. With Outputs::none the state alone.
  Snapshot snapshot();

 private:
  struct Output {
    SnapshotField shape;  // without bytes
    Buffer<uint8_t> buffer;
    size_t zeros_behind = 0;  // bytes at the end of each row
  };
  ObservationIo add_observation(const std::string& name, ElementType type, size_t rows, int size, int row_step,
                                bool final);
  void* add(const std::string& name, size_t per_world, size_t per_agent, size_t element, bool is_float,
            bool observed = false);
  void poison();

  std::unique_ptr<Simulator> sim_;
  std::vector<Output> outputs_;
  Buffer<uint8_t> actions_[kNTeams];
  StepIo io_;
  Buffer<uint8_t> reads_[kNTeams];     // [W]; empty unless Outputs::by_world or in_mirror
  Buffer<uint8_t> mirrored_[kNTeams];  // [W]; empty unless Outputs::in_mirror
};

/// How much happened, so that a test can tell that it tested something. Counts over worlds and steps.
struct Activity {
  int64_t detections = 0, shots = 0, dead = 0, ended = 0, waypoints = 0;
  void add(const Snapshot& snapshot);
};

}  // namespace giga::test
