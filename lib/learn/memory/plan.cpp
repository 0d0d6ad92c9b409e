#include "learn/memory/plan.hpp"

#include <algorithm>
#include <array>
#include <numeric>

#include "core/thread_pool.hpp"
#include "cuda/scratch.hpp"
#include "io/number.hpp"
#include "learn/memory/update.hpp"
#include "learn/team_policy.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "rollout/shapes.hpp"
#include "sim/simulator.hpp"

namespace giga {
namespace {

constexpr int64_t kFloat = 4;
constexpr int64_t kMiB = 1 << 20;
constexpr int64_t kMostWorlds = 16'777'216;  // the limit of train.n_worlds

// What a process takes on a GPU whatever it computes. Measured on an H200 with LibTorch 2.11: 222 to 225 MiB of loaded
// kernels and libraries (what asks for the free memory has made the CUDA context already), and 65 to 70 MiB of cuBLAS
// workspaces, one for each of the two threads that multiply matrices.
constexpr int64_t kCudaFixed = 300 * kMiB;
// What LibTorch's allocator holds in pieces beyond what is in use at the peak, as a share of what comes and goes.
// Measured there, with segments that grow (mappo.cpp): 0.04 to 0.34 (ten runs, 4,096 and 65,536 worlds).
constexpr double kCudaSlack = 0.36;

// The program on the CPU: training with 16 worlds of 5 against 5 reaches 494 MiB resident, 4 MiB of them planned.
constexpr int64_t kCpuFixed = 500 * kMiB;
// glibc gives blocks from 32 MiB back to the system and keeps smaller ones in pieces. Measured while blocks are
// smaller, as multiples of what learning holds at its peak: 1.6 to 3.0 kept (5 against 5; 1,024 and 3,072 worlds of 16
// steps; 1, 2 and 8 minibatches). With MALLOC_MMAP_THRESHOLD_=4194304 in the environment nothing is kept, for a tenth
// to half more CPU time.
constexpr int64_t kHeapBlock = 32 * kMiB;
constexpr double kHeapKept = 3;

BufferSet buffers_of(const TrainConfig& train, int team) {
  if (learns(train, team)) return BufferSet::learning;
  return uses_observation(scripted_of(train.opponent)) ? BufferSet::observations : BufferSet::actions;
}

bool with_state(const LoadedRun& run) { return run.config.mappo.critic.kind == CriticKind::state; }

int64_t scratch_bytes(const LoadedRun& run, Device device, int64_t n_worlds) {
  if (device.is_cuda()) return static_cast<int64_t>(global_scratch_bytes(run.spec.params, n_worlds));
  return static_cast<int64_t>(ScratchLayout(run.spec.params).size) * ThreadPool(run.config.train.n_threads).n_threads();
}

int64_t simulator_bytes(const LoadedRun& run, int64_t n_worlds) {
  return static_cast<int64_t>(state_bytes(run.spec.params.n_agents, n_worlds));
}

int64_t rollout_bytes(const RolloutShapes& shapes) {
  int64_t bytes = shapes.done.bytes();
  for (const TeamRolloutShapes& s : shapes.team)
    bytes += s.obs.bytes() + s.alive.bytes() + s.action.bytes() + s.raw.bytes() + s.log_prob.bytes() + s.reward.bytes();
  return bytes;
}

/// Values, gradients and two moments of all networks.
int64_t parameter_bytes(const LoadedRun& run) {
  int64_t count = 0;
  for (int team = 0; team < kNTeams; ++team) {
    if (!learns(run.config.train, team)) continue;
    count +=
        Actor::count_parameters(run.config.mappo.actor, run.spec.padded_observation_size(), run.spec.params.actions);
    count += Critic::count_parameters(run.config.mappo.critic, critic_shape(run.spec, team));
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

/// Values, advantages and returns of the learning teams.
int64_t advantage_bytes(const LoadedRun& run) {
  int64_t agents = 0;
  for (int team = 0; team < kNTeams; ++team)
    if (learns(run.config.train, team)) agents += run.spec.params.n_team[team];
  return 3 * kFloat * run.config.train.n_worlds * run.config.mappo.horizon * agents;
}

bool any_looks(const std::vector<Scripted>& scripts) {
  return std::any_of(scripts.begin(), scripts.end(), [](Scripted script) { return uses_observation(script); });
}

/// State, scratch and buffers of a match of one team against a script.
int64_t evaluation_bytes(const LoadedRun& run, Device device) {
  const int64_t episodes = run.config.eval.episodes;
  int64_t buffers = 0;
  for (int player = 0; player < kNTeams; ++player) {
    if (!learns(run.config.train, player)) continue;
    int64_t bytes = 0;
    for (int team = 0; team < kNTeams; ++team) {
      const MatchShapes shapes =
          match_shapes(run.spec, team, episodes, team == player || any_looks(run.config.eval.opponents));
      bytes += shapes.action.bytes() + shapes.obs.bytes();
    }
    buffers = std::max(buffers, bytes);
  }
  return buffers + simulator_bytes(run, episodes) + scratch_bytes(run, device, episodes);
}

/// What a checkpoint takes of the host's memory while it is written: the arrays, the file's image, and its bytes.
int64_t checkpoint_bytes(const LoadedRun& run) {
  return 3 * (simulator_bytes(run, run.config.train.n_worlds) + parameter_bytes(run) * 3 / 4);
}

/// What the C library holds on the CPU beyond what is in use at the peak of the largest phase. Grows with the number of
/// worlds, as all parts of the plan do: largest_n_worlds needs that.
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

/// Collects the items.
class PlanBuilder {
 public:
  PlanBuilder(const LoadedRun& run, Device device) : run_(run), device_(device), n_worlds_(run.config.train.n_worlds) {}

  MemoryPlan build();

 private:
  enum class Grows : uint8_t { no, yes };  // whether the bytes are proportional to the number of worlds
  void add(const std::string& name, int64_t bytes, Grows grows, const std::string& note) {
    if (bytes > 0) plan_.items.push_back({name, bytes, grows == Grows::yes ? bytes / n_worlds_ : 0, note});
  }
  void add_simulator();
  void add_buffers();
  int64_t add_work(const WorkPhase& largest);

  const LoadedRun& run_;
  const Device device_;
  const int64_t n_worlds_;
  MemoryPlan plan_;
};

void PlanBuilder::add_simulator() {
  add("simulator: state", simulator_bytes(run_, n_worlds_), Grows::yes, "positions, health, tracking, statistics");
  add("simulator: scratch", scratch_bytes(run_, device_, n_worlds_), device_.is_cuda() ? Grows::yes : Grows::no,
      device_.is_cuda() ? "worlds too large for shared memory" : "one world per thread");
  add("simulator: scenario", static_cast<int64_t>(SimTables(run_.spec, host_memory()).bytes()), Grows::no,
      cat(run_.spec.params.n_agents, " agents, ", run_.spec.params.n_maps, " maps"));
}

// The buffers of LibTorch that stay from the start to the end.
void PlanBuilder::add_buffers() {
  const RolloutSize size{n_worlds_,
                         run_.config.mappo.horizon,
                         with_state(run_),
                         {buffers_of(run_.config.train, 0), buffers_of(run_.config.train, 1)}};
  const RolloutShapes shapes = rollout_shapes(run_.spec, size);
  int64_t final_bytes = 0;
  for (const TeamRolloutShapes& s : shapes.team) final_bytes += s.final_obs.bytes() + s.final_alive.bytes();

  add("rollout", rollout_bytes(shapes), Grows::yes,
      cat(size.horizon, " steps: observations of ", run_.spec.padded_observation_size(), " numbers"));
  add("rollout: final observations", final_bytes, Grows::yes, "of episodes that ran out of time");
  add("rollout: true state", shapes.global.bytes() + shapes.final_global.bytes(), Grows::yes,
      cat("critic.kind state: ", run_.spec.global_size(), " numbers"));
  add("values, advantages, returns", advantage_bytes(run_), Grows::yes, "of the rollout");
  const int64_t n_parameters = parameter_bytes(run_) / (4 * kFloat);
  add("networks", parameter_bytes(run_), Grows::no,
      cat(print_short(static_cast<double>(n_parameters)), " parameters, their gradients, and two moments of Adam"));
  add("normalisers, figures", small_tensor_bytes(run_), Grows::no, "moments of values and observations");
}

// What comes and goes, where it is most.
int64_t PlanBuilder::add_work(const WorkPhase& largest) {
  for (size_t use = 0; use < kNMemoryUses; ++use)
    add(cat(largest.name, ": ", kMemoryUseNames[use]), largest.peak[use], largest.grows ? Grows::yes : Grows::no,
        "given back afterwards");
  return sum(largest.peak);
}

MemoryPlan PlanBuilder::build() {
  add_simulator();
  add_buffers();

  const std::vector<WorkPhase> phases = work_phases(run_, device_);
  const WorkPhase& largest = *std::max_element(phases.begin(), phases.end(),
                                               [](const auto& a, const auto& b) { return sum(a.peak) < sum(b.peak); });
  const int64_t work = add_work(largest);

  const int64_t evaluation = evaluation_bytes(run_, device_);
  const std::string episodes = cat(run_.config.eval.episodes, " episodes at a time");
  if (device_.is_cuda()) {
    add("evaluation", evaluation, Grows::no, episodes);
    add("slack of the allocator", static_cast<int64_t>(kCudaSlack * static_cast<double>(work)), Grows::yes,
        "blocks that LibTorch keeps for later");
    add("CUDA", kCudaFixed, Grows::no, "context, kernels, cuBLAS workspaces");
    return std::move(plan_);
  }
  // On the CPU what learning has given back serves these.
  add("evaluation", evaluation + sum(phases.back().peak) - work, Grows::no, episodes);
  add("checkpoint", checkpoint_bytes(run_) - std::max(work, evaluation + sum(phases.back().peak)), Grows::yes,
      "copies while it is written");
  add("slack of the allocator", heap_slack(phases, work), Grows::no, "pieces that the C library keeps for later");
  add("program", kCpuFixed, Grows::no, "LibTorch and gigastep themselves");
  return std::move(plan_);
}

}  // namespace

int64_t MemoryPlan::total() const {
  int64_t bytes = 0;
  for (const MemoryItem& item : items) bytes += item.bytes;
  return bytes;
}

MemoryPlan plan_memory(const LoadedRun& run, Device device) { return PlanBuilder(run, device).build(); }

int64_t largest_n_worlds(const LoadedRun& run, Device device, int64_t available_bytes) {
  LoadedRun trial = run;
  const auto fits = [&](int64_t n_worlds) {
    trial.config.train.n_worlds = static_cast<int>(n_worlds);
    return plan_memory(trial, device).total() <= available_bytes;
  };
  // n_worlds x horizon must be a multiple of n_minibatches, so n_worlds is one of `unit`.
  const int64_t minibatches = run.config.mappo.n_minibatches;
  const int64_t unit = minibatches / std::gcd(minibatches, static_cast<int64_t>(run.config.mappo.horizon));
  int64_t low = 0, high = kMostWorlds / unit + 1;  // low fits (none does), high does not
  while (high - low > 1) {
    const int64_t middle = low + (high - low) / 2;
    (fits(middle * unit) ? low : high) = middle;
  }
  return low * unit;
}

}  // namespace giga
