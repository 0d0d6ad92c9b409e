// GoldenWorld: the simulator's own stages, run serially.
#include "golden/golden_world.hpp"

#include <algorithm>
#include <limits>

namespace giga::golden {

GoldenWorld::GoldenWorld(SimSpec spec)
    : spec_(std::move(spec)), tables_(spec_, host_memory()), state_(spec_.params.n_agents, 1, host_memory()) {
  const ScratchLayout layout(params());
  scratch_ = Buffer<char>(host_memory(), layout.size);
  view_ = world_view(state_.view(), params().n_agents, 0);
  attach_scratch(view_, layout, scratch_.data());
  terms_.resize(static_cast<size_t>(kNRewardTerms * n_agents()));
  for (int t = 0; t < kNTeams; ++t) {
    const size_t n = static_cast<size_t>(params().n_team[t]);
    team_[t].discrete.resize(n);
    team_[t].continuous.resize(n * kActionSize);
    team_[t].reward.resize(n);
    team_[t].alive.resize(n);
    team_[t].obs.resize(n * static_cast<size_t>(columns()));
  }
}

StepIo GoldenWorld::io() {
  // Nothing left over from an earlier record may pass for a result.
  constexpr float kUnwritten = std::numeric_limits<float>::quiet_NaN();
  StepIo io;
  for (int t = 0; t < kNTeams; ++t) {
    TeamBuffers& team = team_[t];
    std::fill(team.reward.begin(), team.reward.end(), kUnwritten);
    std::fill(team.obs.begin(), team.obs.end(), kUnwritten);
    std::fill(team.alive.begin(), team.alive.end(), uint8_t{77});
    io.team[t].action = params().actions == ActionKind::discrete ? static_cast<const void*>(team.discrete.data())
                                                                 : static_cast<const void*>(team.continuous.data());
    io.team[t].reward = team.reward.data();
    io.team[t].obs[Observation::vector].rows = team.obs.data();
    io.team[t].alive = team.alive.data();
  }
  std::fill(terms_.begin(), terms_.end(), kUnwritten);
  io.terms = terms_.data();
  done_ = 77;
  io.done = &done_;
  return io;
}

void GoldenWorld::step(const int32_t* discrete, const float* continuous, RecordedDraws& draws) {
  for (int i = 0; i < n_agents(); ++i) {
    TeamBuffers& team = team_[team_of(i)];
    if (discrete) team.discrete[slot_of(i)] = discrete[i];
    for (size_t k = 0; continuous && k < kActionSize; ++k)
      team.continuous[slot_of(i) * kActionSize + k] = continuous[static_cast<size_t>(i) * kActionSize + k];
  }
  step_world(SerialLanes{}, params(), view_, draws, io(), {OnDone::keep}, 0);
}

const float* GoldenWorld::observation(int i) const {
  return team_[team_of(i)].obs.data() + slot_of(i) * static_cast<size_t>(columns());
}

float GoldenWorld::term(RewardTerm term, int i) const {
  return terms_[static_cast<size_t>(static_cast<int>(term) * n_agents() + i)];
}

bool GoldenWorld::detected(int target, int observer) const {
  return view_.detected[target * words_for(n_agents()) + observer / 32] >> (observer & 31) & 1u;
}

bool GoldenWorld::seen(int ego, int other) const {
  return view_.seen[ego * words_for(n_agents()) + other / 32] >> (other & 31) & 1u;
}

}  // namespace giga::golden
