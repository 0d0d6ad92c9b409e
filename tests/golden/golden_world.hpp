// GoldenWorld: one world of the simulator that steps and resets with recorded draws.
#pragma once

#include <vector>

#include "core/memory.hpp"
#include "golden/recording.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/vector_observation.hpp"
#include "sim/world.hpp"

namespace giga::golden {

class GoldenWorld {
 public:
  explicit GoldenWorld(SimSpec spec);

  /// Numbers of an agent's vector observation.
  int columns() const { return VectorObservation::shape(params()).size(); }
  const SimSpec& spec() const { return spec_; }
  const SimParams& params() const { return tables_.params(); }
  int n_agents() const { return spec_.params.n_agents; }
  /// The state, to be filled in before a step and read after it, and the scratch of the last step.
  WorldView& view() { return view_; }

  /// One step with OnDone::keep. The actions, by agent: int32 or 3 floats each.
  void step(const int32_t* discrete, const float* continuous, RecordedDraws& draws);
  /// A reset and the observation that follows it. `Draws` is a RecordedDraws or derived from it.
  template <class Draws>
  void reset(Draws& draws) {
    const StepIo buffers = io();
    reset_world(SerialLanes{}, params(), view_, draws);
    observe_world(SerialLanes{}, params(), view_, draws, buffers, 0, true);
  }

  // Of the last step or reset, by agent index.
  float reward(int i) const { return team_[team_of(i)].reward[slot_of(i)]; }
  uint8_t alive(int i) const { return team_[team_of(i)].alive[slot_of(i)]; }
  const float* observation(int i) const;
  float term(RewardTerm term, int i) const;
  bool done() const { return done_ != 0; }
  bool detected(int target, int observer) const;
  bool seen(int ego, int other) const;

 private:
  struct TeamBuffers {
    std::vector<int32_t> discrete;
    std::vector<float> continuous, reward, obs;
    std::vector<uint8_t> alive;
  };
  size_t team_of(int i) const { return static_cast<size_t>(params().team_of(i)); }
  size_t slot_of(int i) const { return static_cast<size_t>(params().slot_of(i)); }
  StepIo io();

  SimSpec spec_;
  SimTables tables_;
  SimState state_;
  Buffer<char> scratch_;
  WorldView view_{};
  TeamBuffers team_[kNTeams];
  std::vector<float> terms_;
  uint8_t done_ = 0;
};

}  // namespace giga::golden
