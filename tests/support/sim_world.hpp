// TestWorld: one world that a test sets up by hand, with draws that the test chooses.
#pragma once

#include <functional>
#include <vector>

#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/vector_observation.hpp"

namespace giga::test {

/// A draw source (see sim/draws.hpp) whose numbers the test sets. As given: no waypoint appears, no stochastic
/// detection succeeds beyond the certain ones, everybody within range is heard, starts lie in the middle of the area.
struct FixedDraws {
  float appear = 0.99f, location[2] = {0.5f, 0.5f}, time = 0.5f;
  int map_index = 0;
  std::function<float(int target, int observer)> detect_draw = [](int, int) { return 0.0f; };
  std::function<float(int ego, int sender, bool after_reset)> comm_draw = [](int, int, bool) { return 0.999f; };
  std::function<float(int agent, int round, StartDraw what)> start_draw = [](int, int, StartDraw) { return 0.5f; };
  int n_maps_asked = 0;

  float waypoint_appears() { return appear; }
  float waypoint_location(int axis) { return location[axis]; }
  float waypoint_time() { return time; }
  float detect(int target, int observer) { return detect_draw(target, observer); }
  float comm(int ego, int sender, bool after_reset) { return comm_draw(ego, sender, after_reset); }
  int map(int n_maps) {
    n_maps_asked = n_maps;
    return map_index;
  }
  float start(int agent, int round, StartDraw what) { return start_draw(agent, round, what); }
};

/// World 1 of 3, so that an index error hits its neighbors, which `neighbors_untouched` checks. All outputs and scratch
/// are poisoned before every call.
class TestWorld {
 public:
  explicit TestWorld(SimSpec spec, OnDone on_done = OnDone::keep);

  FixedDraws draws;

  void start();
  void step();
  void steps(int count) {
    for (int k = 0; k < count; ++k) step();
  }

  /// Puts agent i somewhere, flying level at the speed floor unless said otherwise.
  void put(int i, float x, float y, float heading = 0, float z = 0, float v = 1.3f);
  /// Takes agent i out of the game without moving it.
  void kill(int i);
  /// Controls of agent i from now on (spec with continuous actions); all zero at first.
  void control(int i, float heading, float dive, float throttle);
  /// Whether a team plays in the mirror from now on (TeamIo::mirrored).
  void mirror(int team, bool mirrored);
  /// Discrete action of agent i from now on; 13 (nothing) at first.
  void act(int i, int action);

  const SimParams& params() const { return tables_.params(); }
  float* term_factors() { return tables_.term_factors(); }
  WorldView& now() { return view_; }
  int n_agents() const { return params().n_agents; }
  /// Numbers of an agent's vector observation.
  int columns() const { return VectorObservation::shape(params()).size(); }

  bool alive(int i) const { return view_.alive[i] != 0; }
  /// Did b detect a in the last step?
  bool detected(int a, int b) const { return bit(view_.detected, a, b); }
  /// Did e see a in its last observation?
  bool seen(int e, int a) const { return bit(view_.seen, e, a); }
  int tracked(int target, int shooter) const { return view_.tracked[target * n_agents() + shooter]; }

  float reward(int i) const { return teams_[team(i)].reward[row(i)]; }
  float term(RewardTerm t, int i) const;
  float obs(int e, int column) const { return teams_[team(e)].obs[at(Observation::vector, e, column)]; }
  /// Number `column` of the egocentric view.
  float egocentric(int e, int column) const { return teams_[team(e)].obs[at(Observation::egocentric, e, column)]; }
  float final_obs(int e, int column) const { return teams_[team(e)].final_obs[at(Observation::vector, e, column)]; }
  uint8_t alive_out(int i) const { return teams_[team(i)].alive[row(i)]; }
  uint8_t final_alive(int i) const { return teams_[team(i)].final_alive[row(i)]; }
  Done done() const { return static_cast<Done>(done_[kWorld]); }
  float state(int column) const { return true_state_[kWorld * state_columns() + static_cast<size_t>(column)]; }
  float final_state(int column) const { return final_state_[kWorld * state_columns() + static_cast<size_t>(column)]; }
  float stat(EpisodeStat s) const { return view_.stats[static_cast<int>(s)]; }
  float term_stat(int team, RewardTerm t) const {
    return view_.stats[kNEpisodeStats + team * kNRewardTerms + static_cast<int>(t)];
  }

  /// Whether the worlds before and behind still hold the poison, in outputs and state.
  bool neighbors_untouched() const;

 private:
  static constexpr size_t kWorld = 1, kNWorlds = 3;
  struct Team {
    std::vector<int32_t> indices;
    std::vector<float> controls, obs, final_obs, reward;
    std::vector<uint8_t> alive, final_alive, mirrored;
  };

  size_t team(int i) const { return static_cast<size_t>(params().team_of(i)); }
  size_t row(int i) const { return static_cast<size_t>(team_row(params(), kWorld, i)); }
  size_t stride() const { return static_cast<size_t>(rows_.stride()); }
  size_t at(Observation kind, int e, int column) const {
    return row(e) * stride() + static_cast<size_t>(rows_.columns(kind).first + column);
  }
  size_t state_columns() const { return static_cast<size_t>(state_size(params())); }
  bool bit(const uint32_t* rows, int row, int column) const {
    return (rows[row * words_for(n_agents()) + column / 32] >> (column % 32) & 1u) != 0;
  }
  void poison();
  void run(const Jobs& jobs);

  SimTables tables_;
  SimState state_;
  OnDone on_done_;
  ScratchLayout layout_;
  Buffer<char> scratch_;
  WorldView view_;
  RowLayout rows_;
  Team teams_[kNTeams];
  std::vector<uint8_t> done_;
  std::vector<float> true_state_, final_state_, terms_;
  StepIo io_;
};

}  // namespace giga::test
