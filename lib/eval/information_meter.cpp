#include "eval/information_meter.hpp"

#include <torch/types.h>

#include "core/error.hpp"
#include "policy/mutual_information.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"
#include "sim/row_layout.hpp"
#include "sim/state.hpp"

namespace giga {

/// What a policy has seen of the games so far.
struct InformationMeter::Side {
  NetworkState memory;   // [W n, S]
  InformationSums sums;  // in double: thousands of steps are added up
};

InformationMeter::InformationMeter(const SimSpec& spec, const Minds& minds)
    : stride_(observation_rows(spec).stride()), minds_(minds) {}
InformationMeter::~InformationMeter() = default;

void InformationMeter::before_step(int64_t, GameStep& step) {
  for (int team = 0; team < kNTeams; ++team)
    if (const Policy* policy = minds_[static_cast<size_t>(team)].policy) step.rows[team].wanted |= policy->reads();
}

/// On what agents see now they act next; unless they are dead, or their game is over.
void InformationMeter::after_step(int64_t t, const GameStep& step) {
  at::NoGradGuard no_grad;
  if (t < 0) sides_ = {};  // a match may begin anew, with tables in the place of lists that are too short
  const Simulator& sim = *step.sim;
  const SimParams& params = sim.params();
  GIGA_CHECK(params.team_after_team, "agents of team 1 before those of team 0");
  GIGA_CHECK(sim.options().on_done == OnDone::freeze && sim.options().episodes == 1, "this is no match");
  const StateView& state = sim.state().view();
  const int64_t worlds = sim.n_worlds();
  static_assert(sizeof(Phase) == 1);
  const at::Tensor plays =
      wrap(reinterpret_cast<const uint8_t*>(state.phase), {worlds, 1}, sim.device()).eq(static_cast<int>(Phase::plays));
  const at::Tensor acts = wrap(state.alive, {worlds, params.n_agents}, sim.device()).ne(0).logical_and(plays);
  for (int team = 0; team < kNTeams; ++team) {
    const auto side = static_cast<size_t>(team);
    const Mind& mind = minds_[side];
    if (!mind.policy) continue;
    const int64_t n = params.n_team[team], first = team == 0 ? 0 : params.n_team[0];
    const at::Tensor obs = mind.policy->reads_image()
                               ? wrap(static_cast<const uint8_t*>(step.io.team[team].obs[Observation::image].rows),
                                      {worlds * n, image_bytes(params.resolution)}, sim.device())
                               : wrap(step.rows[team].obs, {worlds * n, stride_}, sim.device());
    if (!sides_[side]) sides_[side] = std::make_unique<Side>();
    Side& seen = *sides_[side];
    const at::Tensor head = mind.policy->forward(obs, seen.memory);
    const at::Tensor weight = acts.narrow(1, first, n).reshape({-1}).to(head);
    const InformationSums now = information_sums(*mind.policy, head, weight, mind.greedy);
    const auto add = [](at::Tensor& sum, const at::Tensor& more) {
      sum = sum.defined() ? sum + more : more.to(at::kDouble);
    };
    add(seen.sums.rows, now.rows);
    add(seen.sums.policy, now.policy);
    add(seen.sums.entropies, now.entropies);
  }
}

std::array<std::optional<double>, kNTeams> InformationMeter::nats() const {
  std::array<std::optional<double>, kNTeams> all;
  for (size_t side = 0; side < kNTeams; ++side)
    if (sides_[side]) all[side] = mutual_information(sides_[side]->sums).item<double>();
  return all;
}

}  // namespace giga
