#include "learn/memory/mappo.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "io/number.hpp"
#include "learn/memory/items.hpp"
#include "learn/memory/update.hpp"
#include "learn/opponents/world_shares.hpp"
#include "learn/team_policy.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "rollout/shapes.hpp"

namespace giga {
namespace {

using Grows = PlanItems::Grows;

// What the C library keeps in pieces while blocks are smaller than kHeapBlock, as multiples of what learning holds at
// its peak. Measured: 1.6 to 3.0 (5 against 5; 1,024 and 3,072 worlds of 16 steps; 1, 2 and 8 minibatches). With
// MALLOC_MMAP_THRESHOLD_=4194304 in the environment nothing is kept, for a tenth to half more CPU time.
constexpr double kHeapKept = 3;

BufferSet buffers_of(const TrainConfig& train, int team) {
  if (learns(train, team)) return BufferSet::learning;
  return uses_observation(scripted_of(train.opponent)) ? BufferSet::observations : BufferSet::actions;
}

bool with_state(const LoadedRun& run) { return run.config.mappo.critic.kind == CriticKind::state; }

int64_t rollout_bytes(const RolloutShapes& shapes) {
  int64_t bytes = shapes.done.bytes();
  for (const TeamRolloutShapes& s : shapes.team)
    bytes += s.obs.bytes() + s.alive.bytes() + s.action.bytes() + s.raw.bytes() + s.log_prob.bytes() + s.reward.bytes();
  return bytes;
}

int64_t actor_parameters(const LoadedRun& run) {
  return Actor::count_parameters(run.config.mappo.actor, input_columns(run.config.mappo.actor.inputs, run.spec),
                                 run.spec.params.actions);
}

/// Values, gradients and two moments of all networks.
int64_t parameter_bytes(const LoadedRun& run) {
  int64_t count = 0;
  for (int team = 0; team < kNTeams; ++team) {
    if (!learns(run.config.train, team)) continue;
    count += actor_parameters(run) +
             Critic::count_parameters(run.config.mappo.critic, critic_shape(run.config.mappo.critic, run.spec, team));
  }
  return 4 * kFloat * count;
}

/// Moments of observations (four vectors and a count for each learning team), and what has a few numbers: the value
/// normaliser, the figures of an update, the steps of Adam, each in a block of its own.
int64_t small_tensor_bytes(const LoadedRun& run) {
  constexpr int64_t kScalars = 4096;
  const int64_t moments = run.config.mappo.obs_norm ? kFloat * (4 * run.spec.padded_observation_size() + 16) : 0;
  int64_t bytes = 0;
  for (int team = 0; team < kNTeams; ++team)
    if (learns(run.config.train, team)) bytes += moments + kScalars;
  return bytes;
}

/// Values (of one step more), advantages and returns of the learning teams.
int64_t advantage_bytes(const LoadedRun& run) {
  int64_t agents = 0;
  for (int team = 0; team < kNTeams; ++team)
    if (learns(run.config.train, team)) agents += run.spec.params.n_team[team];
  return kFloat * run.config.train.n_worlds * (3 * run.config.mappo.horizon + 1) * agents;
}

/// Numbers of a past policy: GroupPolicy::row_of.
int64_t policy_numbers(const LoadedRun& run) {
  return actor_parameters(run) + (run.config.mappo.obs_norm ? 2 * run.spec.padded_observation_size() : 0);
}

/// What the C library holds on the CPU beyond what is in use at the peak of the largest phase. Grows with the number of
/// worlds, as all parts of the plan do: largest_size needs that.
int64_t heap_slack(const std::vector<WorkPhase>& phases, int64_t largest) {
  double kept = 0;
  for (const WorkPhase& phase : phases) {
    if (!phase.has_gradients) continue;
    const double blocks = static_cast<double>(phase.largest_block);
    kept = kHeapKept * static_cast<double>(sum(phase.peak)) * std::min(1.0, static_cast<double>(kHeapBlock) / blocks);
  }
  double most = 0;
  for (const WorkPhase& phase : phases) {
    const auto work = static_cast<double>(sum(phase.peak));
    // Small blocks are taken from what is kept; learning itself has a share of 1 / kHeapKept in it.
    const double in_kept = phase.has_gradients ? kept / kHeapKept : phase.largest_block < kHeapBlock ? work : 0;
    most = std::max(most, work + std::max(0.0, kept - in_kept));
  }
  return static_cast<int64_t>(most) - largest;
}

RolloutShapes shapes_of(const LoadedRun& run) {
  const TrainConfig& c = run.config.train;
  return rollout_shapes(run.spec,
                        {c.n_worlds, run.config.mappo.horizon, with_state(run), {buffers_of(c, 0), buffers_of(c, 1)}});
}

/// What LibTorch's allocator on a GPU keeps beyond what is in use at the peak.
int64_t cuda_slack(const LoadedRun& run, int64_t work) {
  const bool in_parts =
      world_shares(run.config.opponents, run.config.train.n_worlds).learning(0).count != run.config.train.n_worlds;
  const int64_t gathered_from = in_parts ? rollout_bytes(shapes_of(run)) : 0;
  return static_cast<int64_t>(kCudaSlack * static_cast<double>(work) +
                              kCudaSlackOfParts * static_cast<double>(gathered_from));
}

// The buffers of LibTorch that stay from the start to the end.
void add_buffers(PlanItems& items, const LoadedRun& run) {
  const RolloutShapes shapes = shapes_of(run);
  int64_t final_bytes = 0;
  for (const TeamRolloutShapes& s : shapes.team) final_bytes += s.final_obs.bytes() + s.final_alive.bytes();

  items.add("rollout", rollout_bytes(shapes), Grows::yes,
            cat(run.config.mappo.horizon, " steps: observations of ", run.spec.padded_observation_size(), " numbers"));
  items.add("rollout: final observations", final_bytes, Grows::yes, "of episodes that ran out of time");
  items.add("rollout: true state", shapes.global.bytes() + shapes.final_global.bytes(), Grows::yes,
            cat("critic.kind state: ", run.spec.global_size(), " numbers"));
  items.add("values, advantages, returns", advantage_bytes(run), Grows::yes, "of the rollout");
  const int64_t n_parameters = parameter_bytes(run) / (4 * kFloat);
  items.add(
      "networks", parameter_bytes(run), Grows::no,
      cat(print_short(static_cast<double>(n_parameters)), " parameters, their gradients, and two moments of Adam"));
  items.add("normalisers, figures", small_tensor_bytes(run), Grows::no, "moments of values and observations");
}

// What a League has: both teams' present and past policies, those that play, and a network that tells their shape, with
// its gradients; the places of the teams' worlds in the rollout.
void add_opponents(PlanItems& items, const LoadedRun& run) {
  const OpponentsConfig& opponents = run.config.opponents;
  const WorldShares shares = world_shares(opponents, run.config.train.n_worlds);
  if (opponents.pool_size > 0) {
    const int64_t policies = 1 + opponents.pool_size + shares.groups;
    items.add("opponents: past policies",
              kNTeams * kFloat * (policies * policy_numbers(run) + 2 * actor_parameters(run)), Grows::no,
              cat("opponents.pool_size ", opponents.pool_size, ", ", shares.groups, " at a time"));
  }
  if (shares.side() > 0)
    items.add(
        "opponents: who learns where",
        kNTeams * static_cast<int64_t>(sizeof(int64_t)) * shares.learning(0).count * (run.config.mappo.horizon + 1) +
            shares.n_worlds,
        Grows::yes, cat(shares.self_play().count, " worlds of self-play"));
}

// What comes and goes, where it is most.
void add_work(PlanItems& items, const WorkPhase& largest) {
  for (size_t use = 0; use < kNMemoryUses; ++use)
    items.add(cat(largest.name, ": ", kMemoryUseNames[use]), largest.peak[use], largest.grows ? Grows::yes : Grows::no,
              "given back afterwards");
}

}  // namespace

MemoryPlan plan_mappo(const LoadedRun& run, Device device) {
  PlanItems items(run, device);
  items.add_simulator(run.config.train.n_worlds);
  add_buffers(items, run);
  add_opponents(items, run);

  const std::vector<WorkPhase> phases = work_phases(run, device);
  const WorkPhase& largest = *std::max_element(phases.begin(), phases.end(),
                                               [](const auto& a, const auto& b) { return sum(a.peak) < sum(b.peak); });
  add_work(items, largest);
  const int64_t work = sum(largest.peak);
  // Gradients are not saved.
  const int64_t saved = simulator_bytes(run, run.config.train.n_worlds) + parameter_bytes(run) * 3 / 4 +
                        kNTeams * kFloat * run.config.opponents.pool_size * policy_numbers(run);
  const int64_t slack = device.is_cuda() ? cuda_slack(run, work) : heap_slack(phases, work);
  items.add_rest({work, sum(phases.back().peak), saved, slack});
  return items.plan();
}

}  // namespace giga
