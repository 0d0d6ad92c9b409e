#include "learn/memory/items.hpp"

#include <algorithm>
#include <vector>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "cuda/runtime.hpp"
#include "cuda/scratch.hpp"
#include "game/shapes.hpp"
#include "learn/team_policy.hpp"
#include "sim/simulator.hpp"

namespace giga {
namespace {

// What a process takes on a GPU whatever it computes. Measured on an H200 with LibTorch 2.11: 222 to 225 MiB of loaded
// kernels and libraries (what asks for the free memory has made the CUDA context already), and 65 to 70 MiB of cuBLAS
// workspaces, one for each of the two threads that multiply matrices: the program's and that of gradients, which
// evolution has not.
constexpr int64_t kCudaFixed = 300 * kMiB, kCudaFixedWithoutGradients = kCudaFixed - 35 * kMiB;
// The program on the CPU: training with 16 worlds of 5 against 5 reaches 494 MiB resident where it links the CUDA part
// of LibTorch, 154 MiB where it does not, 4 MiB of them planned. There, runs of some hundred MiB take up to 25 MiB
// more, which the allocator keeps.
int64_t cpu_fixed() { return (built_with_cuda() ? 500 : 190) * kMiB; }
// A checkpoint is there three times while it is written: the arrays, the file's image, and its bytes.
constexpr int64_t kCheckpointCopies = 3;

int64_t scratch_bytes(const LoadedRun& run, Device device, int64_t n_worlds) {
  if (device.is_cuda()) return static_cast<int64_t>(global_scratch_bytes(run.spec.params, n_worlds));
  return static_cast<int64_t>(ScratchLayout(run.spec.params).size) * ThreadPool(run.config.train.n_threads).n_threads();
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
      const GameShapes shapes =
          game_shapes(run.spec, team, episodes, team == player || any_looks(run.config.eval.opponents));
      bytes += shapes.action.bytes() + shapes.obs.bytes();
    }
    buffers = std::max(buffers, bytes);
  }
  return buffers + simulator_bytes(run, episodes) + scratch_bytes(run, device, episodes);
}

}  // namespace

int64_t simulator_bytes(const LoadedRun& run, int64_t n_worlds) {
  return static_cast<int64_t>(state_bytes(run.spec.params.n_agents, n_worlds));
}

void PlanItems::add_simulator(int64_t n_worlds) {
  const bool cuda = device_.is_cuda();
  add("simulator: state", simulator_bytes(run_, n_worlds), Grows::yes, "positions, health, tracking, statistics");
  add("simulator: scratch", scratch_bytes(run_, device_, n_worlds), cuda ? Grows::yes : Grows::no,
      cuda ? "worlds too large for shared memory" : "one world per thread");
  add("simulator: scenario", static_cast<int64_t>(SimTables(run_.spec, host_memory()).bytes()), Grows::no,
      cat(run_.spec.params.n_agents, " agents, ", run_.spec.params.n_maps, " maps"));
}

void PlanItems::add_rest(const Rest& rest) {
  const int64_t evaluation = evaluation_bytes(run_, device_);
  const std::string episodes = cat(run_.config.eval.episodes, " episodes at a time");
  if (device_.is_cuda()) {
    add("evaluation", evaluation, Grows::no, episodes);
    add("slack of the allocator", rest.slack, Grows::yes, "blocks that LibTorch keeps for later");
    const bool gradients = !is_evolution(run_.config.train);
    add("CUDA", gradients ? kCudaFixed : kCudaFixedWithoutGradients, Grows::no, "context, kernels, cuBLAS workspaces");
    return;
  }
  // On the CPU what learning has given back serves these.
  const int64_t evaluating = evaluation + rest.acting;
  add("evaluation", evaluating - rest.work, Grows::no, episodes);
  add("checkpoint", kCheckpointCopies * rest.checkpoint - std::max(rest.work, evaluating),
      is_evolution(run_.config.train) ? Grows::no : Grows::yes, "copies while it is written");
  add("slack of the allocator", rest.slack, Grows::no, "pieces that the C library keeps for later");
  add("program", cpu_fixed(), Grows::no, "LibTorch and gigastep themselves");
}

}  // namespace giga
