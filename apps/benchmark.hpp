// What `gigastep bench` measures, and how: repeats after a warm-up, and figures that prove the work was done.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/joined_ranks.hpp"
#include "core/memory.hpp"
#include "learn/learner.hpp"

namespace giga {

struct BenchOptions {
  std::string scenario = "identical_5_vs_5";  ///< empty: as the config says (train, es)
  std::vector<int> worlds;                    ///< empty: one size that fills the device
  std::string device = "auto";
  int64_t steps = 0;  ///< per repeat; 0 = about half a second of them
  int repeats = 7;
  uint64_t seed = 0;                                      ///< of sim and closed-loop
  bool nothing_stored = false;                            ///< sim: neither observations nor rewards are written
  std::vector<int> hidden = {64, 64};                     ///< closed-loop: of both policies
  Precision precision = TrainConfig{}.precision;          ///< of a closed loop
  CompileStep compile_step = TrainConfig{}.compile_step;  ///< sim and closed-loop
  Pairs pairs = TrainConfig{}.pairs;                      ///< sim and closed-loop
  std::string config = "mappo";                           ///< train and es
  std::vector<std::string> overrides;                     ///< train and es
  std::string json;
  std::string compare;      ///< results of an earlier call, as its --json wrote them; empty: none
  bool proof = false;       ///< print BenchResult::checks
  RankOptions ranks;        ///< train and es
  Ranks* joined = nullptr;  ///< train and es: those that are measured together; null: this process alone
};

/// What a piece of work made. A learner says how long the device played and learned for it.
struct Work {
  double agent_steps = 0, rollout_seconds = 0, learning_seconds = 0;
};

/// One measurement.
struct BenchResult {
  std::string scenario;
  std::string arithmetic;              ///< of the networks' matrix products, or of the simulation where there are none
  std::string closed_loop_arithmetic;  ///< es: of the closed loop beside it
  std::string step_way;                ///< Simulator::step_way
  int worlds = 0;
  int64_t steps = 0;          ///< per repeat; training: updates, es: generations
  std::vector<double> rates;  ///< agent-steps per second of each repeat, sorted
  Work work;                  ///< of all repeats together, without the warm-up
  double bytes = 0;           ///< per agent-step that must at least cross the memory; 0 = not counted
  double copy_rate = 0;      ///< bytes per second, read and written, of a copy in the device's memory; 0 = not measured
  int64_t memory_bytes = 0;  ///< GPU: taken from its free memory; CPU: resident set of the process
  std::vector<std::pair<std::string, double>> checks;
  int ranks = 1;
  std::shared_ptr<const BenchResult> one_rank;  ///< of several: one of them alone, with as many worlds as each

  /// The rate below which a share of the repeats lies, interpolated between neighbours; 0.5 = median.
  double quantile(double share) const;
};

/// Random actions made on the device, observations, rewards and ends of both teams written to memory at each step.
BenchResult bench_sim(const BenchOptions& options, Device device, int worlds);
/// The same with two policy networks, which read the observations and draw the actions.
BenchResult bench_closed_loop(const BenchOptions& options, Device device, int worlds);
/// The same for a run: its scenario with its changes, its networks, train.n_worlds worlds.
BenchResult bench_closed_loop(const BenchOptions& options, Device device, const LoadedRun& run);
/// Whole updates of a learner. `worlds`: of each rank; 0: as the config says.
BenchResult bench_train(const BenchOptions& options, Device device, int worlds);

/// Whole generations of an evolution strategy; only steps inside episodes count. Beside it the closed loop of the same
/// networks with as many worlds, and the share of its rate, but for several ranks. `worlds`: of each rank; 0: as the
/// config says.
BenchResult bench_es(const BenchOptions& options, Device device, int worlds);

/// Memory in use, for differences: of a GPU by everybody, of the CPU by this process.
int64_t memory_in_use(Device device);

/// The arithmetic of a run's networks on a device, by its name in the config.
std::string arithmetic_of(const LoadedRun& run, Device device);

/// Measures one rank alone, on rank 0, while the others wait, and then all: `one` and `all` do so with a run for one
/// rank and for all. Without others only the former.
BenchResult with_one_rank_beside(const BenchOptions& options,
                                 const std::function<BenchResult(const BenchOptions&)>& one,
                                 const std::function<BenchResult(const BenchOptions&)>& all);

/// What some updates of a learner did.
struct Updates {
  Work work;
  double episodes = 0;  ///< that ended
  Metrics last;         ///< figures of the last one
};
Updates make_updates(Learner& learner, int64_t n);

/// Runs `play(n)`, which does n steps and waits for them, first to warm up and to find the number of steps, then
/// `repeats` times; fills steps, rates and work. Several ranks do as many steps, by the clock of rank 0.
/// `piece`: where they are done so many at a time, the first such piece by itself and the second recorded, both come
/// before what is timed, and steps that are not asked for are whole pieces.
void measure(const BenchOptions& options, const std::function<Work(int64_t)>& play, BenchResult& result,
             int64_t piece = 1);

}  // namespace giga
