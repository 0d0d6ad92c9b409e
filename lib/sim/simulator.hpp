// Simulator: many worlds of one scenario on one device, stepped together.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/error.hpp"
#include "core/memory.hpp"
#include "core/named_array.hpp"
#include "sim/recorded_work.hpp"
#include "sim/schedule.hpp"
#include "sim/spec.hpp"
#include "sim/world.hpp"

namespace giga {

struct Redraw;  // sim/image_state.hpp

/// Whether a GPU compiles the step of a scenario for it (cuda/step_compiler.hpp); the numbers are the same.
enum class CompileStep : uint8_t {
  never,
  automatic,  ///< where no kernel of the program has its parameters as constants (sim/usual_params.hpp)
  always,
};

/// How it is known which pairs of agents matter. The numbers are the same (rules 17).
enum class Pairs : uint8_t {
  automatic,  ///< by place where that is faster (finds_by_place), except where there are images; else tables
  tables,     ///< tables of all pairs; by place above kMaxAgents, where there are none
  by_place    ///< in a grid of cells, with lists of a fixed length for each agent
};
/// Plain worlds of 128 agents, tables or by place, far apart and crowded, in M agent-steps/s: 256 worlds on an H200 180
/// or 466 and 82 or 186, one world 0.84 or 5.3 and 0.83 or 4.3; 62 worlds on two cores 1.9 or 6.1 and 2.3 or 2.8. Of
/// 100 agents 256 worlds 205 or 408 and 88 or 159, one 0.83 or 4.1 and 0.87 or 3.3; 1,024 worlds 360 or 426 and 227 or
/// 225.
constexpr int kByPlaceFrom = 100;    ///< where a list of fire holds a whole team, so that no game can end in an error
constexpr int kByPlaceAlways = 128;  ///< whatever the teams

struct SimOptions {
  int n_worlds = 1;
  uint64_t seed = 0;
  int64_t first_world = 0;  ///< global number of world 0 here, for runs on several devices
  OnDone on_done = OnDone::reset;
  int n_threads = 0;        ///< CPU back end: 0 = as many as cores
  int64_t draw_period = 0;  ///< worlds so far apart draw the same numbers (see draw_world); 0 = none do
  /// OnDone::freeze: episodes that a world plays before it waits, counted in its statistics, so do not read these in
  /// between. More than one needs a scenario with a time limit.
  int episodes = 1;
  Pairs pairs = Pairs::automatic;
  int most_shooters = kMostShooters;  ///< by place: opponents whose fire at one agent is counted
  CompileStep compile_step = CompileStep::never;
};

inline SimOptions with_pairs(SimOptions options, Pairs pairs) {
  options.pairs = pairs;
  return options;
}

/// By place: more opponents fired at an agent than are counted. A simulator throws it where it is next waited for.
class FullListsError : public Error {
 public:
  using Error::Error;
};

/// Whether a simulator of these options finds pairs by place.
bool finds_by_place(const SimSpec& spec, const SimOptions& options);

/// Sums over all episodes that ended since the last reading.
struct EpisodeStats {
  std::array<double, kNStatRows> rows{};
  double operator[](EpisodeStat s) const { return rows[static_cast<size_t>(s)]; }
  /// Sum of the returns of one reward term over a team's episodes.
  double term(int team, RewardTerm t) const {
    const int row = kNEpisodeStats + team * kNRewardTerms + static_cast<int>(t);
    return rows[static_cast<size_t>(row)];
  }
};

/// The scenario's tables in the memory of a device.
class SimTables {
 public:
  SimTables() = default;
  SimTables(const SimSpec& spec, Memory& memory);
  /// `spec.params` with its pointers set.
  const SimParams& params() const { return params_; }
  /// SimParams::term_factors, to be written.
  float* term_factors() { return term_factors_.data(); }

 private:
  SimParams params_;
  Buffer<int32_t> sprites_;
  Buffer<float> floats_;
  Buffer<Box> boxes_;
  Buffer<float> box_features_;
  Buffer<StartArea> start_;
  Buffer<uint8_t> pictures_;
  Buffer<uint16_t> paths_;
  Buffer<float> term_factors_;
};

/// How large the state of a world is. What it keeps of pairs are tables [N, N], or lists of bounded length.
struct StateShape {
  int n_agents = 0;
  int shooters = 0;  ///< entries of an agent's list of fire; 0 = tables
  int rows = 0;      ///< agents of an observation's rows; with lists

  StateShape(int agents) : n_agents(agents) {}                      // NOLINT(google-explicit-constructor): of tables
  StateShape(const SimSpec& spec, const SimOptions& options = {});  // NOLINT(google-explicit-constructor)
  bool lists() const { return shooters > 0; }
};

/// What worlds of many agents keep of pairs (grid.hpp).
struct PairLists {
  uint32_t* fire = nullptr;       // [W, N, shooters]
  uint32_t* neighbors = nullptr;  // [W, N, rows]
};

/// Calls f(name, pointer to the array, elements of a world) for every array of a state of that shape, in their order.
template <class View, class Lists, class F>
void for_each_array(const StateShape& shape, View& view, Lists& lists, F&& f) {
  const int64_t n = shape.n_agents;
  for_each_field([&](auto field, auto member) {
    if (shape.lists() && (field.per == Per::pair || field.per == Per::agent_words)) return;
    f(field.name, view.*member, field.count(shape.n_agents));
  });
  if (!shape.lists()) return;
  f("fire", lists.fire, n * shape.shooters);
  f("neighbors", lists.neighbors, n * shape.rows);
}

/// Bytes of the state of `n_worlds` worlds.
size_t state_bytes(const StateShape& shape, int64_t n_worlds);
/// Where its arrays lie in them.
void lay_out_state(const StateShape& shape, int64_t n_worlds, uint8_t* bytes, StateView& view, PairLists& lists);

/// The state of all worlds in the memory of a device.
class SimState {
 public:
  SimState() = default;
  SimState(const StateShape& shape, int n_worlds, Memory& memory);
  const StateShape& shape() const { return shape_; }
  /// With lists the members for pairs are null.
  const StateView& view() const { return view_; }
  const PairLists& lists() const { return lists_; }
  /// All bytes of the state in the order of the field list.
  std::vector<uint8_t> save() const { return bytes_.to_host(); }
  void load(const std::vector<uint8_t>& bytes);
  /// How often a state was loaded.
  int64_t n_loads() const { return n_loads_; }

  /// The same field by field, as arrays PREFIX/NAME [W, elements of a world]. `load` throws InputError where one is
  /// missing or has another size.
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  StateShape shape_ = 0;
  int n_worlds_ = 0;
  int64_t n_loads_ = 0;
  Buffer<uint8_t> bytes_;
  StateView view_{};
  PairLists lists_;
};

/// Common to all back ends. Work is queued (CUDA: on the simulator's stream) and results are read after `synchronize`,
/// or by work queued behind it on the same stream.
class Simulator {
 public:
  Simulator(SimSpec spec, const SimOptions& options, Memory& memory);
  virtual ~Simulator() = default;

  const SimSpec& spec() const { return spec_; }
  const SimOptions& options() const { return options_; }
  const SimParams& params() const { return tables_.params(); }
  /// With SimParams::has_term_factors: [kNRewardTerms] by RewardTerm, in the memory of the device, what each term is
  /// multiplied with besides its weight. Whoever queues a change of them does so on the stream of the steps; it holds
  /// for those behind it, recorded ones too. No part of the state. Null without.
  float* term_factors() { return tables_.term_factors(); }
  Memory& memory() const { return *memory_; }
  Device device() const { return memory_->device(); }
  int n_worlds() const { return options_.n_worlds; }
  SimState& state() { return state_; }
  const SimState& state() const { return state_; }
  /// Agents stepped by one step of all worlds.
  int64_t agents_per_step() const { return static_cast<int64_t>(options_.n_worlds) * spec_.params.n_agents; }

  /// Starts the first episode of every world and writes the observations and alive flags of `io`.
  void start(const StepIo& io);
  /// One step of every world; reads the actions of both teams and writes the rest of `io`. Of a world that waits, only
  /// reward and done are written: its observations are those that its last step wrote. Its images may be drawn again,
  /// which makes the same.
  void step(const StepIo& io);
  /// The two halves of a step, for work of several steps that is recorded: `begin_steps` counts steps that follow, no
  /// more than there are until the playing worlds are listed again (kListPeriod), after it has listed them where that
  /// is due; `queue_step` does one.
  void begin_steps(int count);
  /// Steps until the playing worlds are listed again; 0: before the next one.
  int steps_to_list() const { return n_lists() == 0 ? 0 : steps_to_list_; }
  void queue_step(const StepIo& io);
  /// Records what `work` queues on the stream of this simulator, and on up to `most_beside` streams side by side:
  /// kernels that have run before, nothing that waits. Null where the back end records nothing; then `work` is not
  /// called. Throws DeviceError where the device refuses; then nothing is recorded, and the same work can be queued as
  /// ever.
  virtual std::unique_ptr<RecordedWork> record(size_t /*most_beside*/,
                                               const std::function<void(Recording&)>& /*work*/) {
    return nullptr;
  }
  /// Writes the observations and alive flags of `io` once more, for buffers that do not hold them (after loading a
  /// state): for every world, including waiting ones, exactly as its last start or step wrote them.
  void observe(const StepIo& io);
  /// Draws ego images again from rows of Observation::image_state, all in the memory of the device; the same bytes as
  /// those that were drawn beside these rows.
  virtual void redraw(const Redraw& request) = 0;
  /// Whether the last kernel of a step lets one that is launched early begin before it has ended
  /// (cuda/early_launch.cuh).
  virtual bool step_lets_next_begin() const { return false; }
  /// What steps the worlds where there are several ways, in words: "the general kernel (...)"; else empty.
  virtual std::string step_way() const { return {}; }
  /// Sums of finished episodes since the last call; waits for queued steps.
  virtual EpisodeStats take_stats() = 0;
  /// OnDone::freeze: whether all worlds wait, as far as is known without waiting for the steps queued last: on a GPU it
  /// is known some steps later, the same number in every run, and the host waits for the steps before those.
  virtual bool over() { return false; }
  /// Waits until everything queued is done.
  virtual void synchronize() {}

 protected:
  /// Runs `jobs` (run_job in step.hpp) in each of the worlds.
  virtual void run(const Jobs& jobs, const StepIo& io, Worlds worlds) = 0;
  /// Lists the worlds that play now, for Worlds::listed. Only called with OnDone::freeze.
  virtual void list_playing() = 0;
  /// Lists of playing worlds made since the start or since a state was loaded, which makes older ones void.
  int64_t n_lists() const { return listed_loads_ == state_.n_loads() ? n_lists_ : 0; }
  Ending ending() const { return {options_.on_done, options_.episodes}; }

  SimSpec spec_;
  SimOptions options_;
  Memory* memory_;
  SimTables tables_;
  SimState state_;

 private:
  int64_t n_lists_ = 0, listed_loads_ = 0;
  int steps_to_list_ = 0;  // until the next list
};

/// take_stats of a back end whose state lies in host memory.
EpisodeStats take_host_stats(const StateView& state, int64_t n_worlds);

/// Worlds in parallel over threads, with tables of pairs whatever the options say: of at most kMaxAgents agents.
std::unique_ptr<Simulator> make_cpu_simulator(SimSpec spec, const SimOptions& options);
/// Pairs found by place (rules 17) whatever the options say: several worlds to a thread, or, where there are fewer,
/// one world after the other, its agents in parallel.
std::unique_ptr<Simulator> make_grid_simulator(SimSpec spec, const SimOptions& options);

}  // namespace giga
