// gigastep bench sim and closed-loop: worlds stepped with random actions, or by policies.
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "apps/benchmark.hpp"
#include "config/fields.hpp"
#include "core/error.hpp"
#include "core/seeds.hpp"
#include "cuda/runtime.hpp"
#include "game/game.hpp"
#include "learn/libtorch_settings.hpp"
#include "learn/team_policy.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/stream.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

/// Has everything written that a learner may want: of the numbers and images what agents are given.
class EveryOutput final : public GameObserver {
 public:
  explicit EveryOutput(const Simulator& sim)
      : done_(sim.memory(), static_cast<size_t>(sim.n_worlds())), numbers_(!sim.params().images_only) {
    for (int k = 0; k < kNTeams; ++k) {
      const size_t n = static_cast<size_t>(sim.n_worlds()) * static_cast<size_t>(sim.params().n_team[k]);
      const auto row = static_cast<size_t>(observation_rows(sim.spec()).stride());
      team_[k].obs = Buffer<float>(sim.memory(), numbers_ ? n * row : 0);
      team_[k].images = Buffer<uint8_t>(sim.memory(), n * static_cast<size_t>(image_bytes(sim.params().resolution)));
      team_[k].reward = Buffer<float>(sim.memory(), n);
      team_[k].alive = Buffer<uint8_t>(sim.memory(), n);
    }
  }
  void before_step(int64_t, GameStep& step) override {
    for (int k = 0; k < kNTeams; ++k) {
      if (numbers_) {
        want(step.rows[k].obs, team_[k].obs.data());
        step.rows[k].wanted = ObservationSet::all();
      }
      step.io.team[k].obs[Observation::image].rows = team_[k].images.data();
      want(step.io.team[k].reward, team_[k].reward.data());
      want(step.io.team[k].alive, team_[k].alive.data());
    }
    want(step.io.done, done_.data());
  }
  bool repeats_plays() const override { return true; }
  std::vector<float> obs(int team) const { return team_[team].obs.to_host(); }
  /// The first and the last images of a team, of which there may be more than the host has room for.
  std::vector<uint8_t> some_images(int team, Memory& memory) const {
    constexpr size_t kMost = 16 << 20;
    const Buffer<uint8_t>& all = team_[team].images;
    const size_t size = std::min(kMost, all.size());
    std::vector<uint8_t> bytes(2 * size);
    memory.to_host(bytes.data(), all.data(), size);
    memory.to_host(bytes.data() + size, all.data() + all.size() - size, size);
    return bytes;
  }

 private:
  struct Team {
    Buffer<float> obs, reward;  // [W, n, padded D], [W, n]
    Buffer<uint8_t> images;     // [W, n, R, R, 3]
    Buffer<uint8_t> alive;      // [W, n]
  };
  Team team_[kNTeams];
  Buffer<uint8_t> done_;
  const bool numbers_;
};

LoadedRun bench_run(const BenchOptions& options, int worlds) {
  LoadedRun run;
  run.config.scenario = options.scenario;
  run.config.seed = options.seed;
  run.config.train.n_worlds = worlds;
  run.config.train.precision = options.precision;
  run.config.train.compile_step = options.compile_step;
  run.config.train.pairs = options.pairs;
  run.config.mappo.actor.hidden = options.hidden;
  run.scenario = load_scenario(options.scenario, data_dirs());
  run.spec = compile(run.scenario);
  return run;
}

/// Steps that are played in one go.
constexpr int64_t kPlaySteps = 64;

/// Worlds whose present episode is not their first: their clock shows less than the steps made.
int64_t worlds_reset(Simulator& sim, int64_t steps) {
  std::vector<int32_t> length(static_cast<size_t>(sim.n_worlds()));
  sim.memory().to_host(length.data(), sim.state().view().episode_length, length.size() * sizeof(int32_t));
  int64_t count = 0;
  for (const int32_t l : length) count += l < steps ? 1 : 0;
  return count;
}

BenchResult play(const BenchOptions& options, Device device, const LoadedRun& run,
                 std::shared_ptr<TeamController> team0, std::shared_ptr<TeamController> team1) {
  BenchResult result;
  result.scenario = run.config.scenario;
  result.worlds = run.config.train.n_worlds;
  const int64_t memory_before = device.is_cuda() ? memory_in_use(device) : 0;
  SimOptions sim_options;
  sim_options.n_worlds = result.worlds;
  sim_options.seed = seed_of(options.seed, Purpose::bench);
  sim_options.compile_step = run.config.train.compile_step;
  sim_options.pairs = run.config.train.pairs;
  void* const stream = current_stream(device);
  const auto sim = make_simulator(run.spec, sim_options, device, stream);
  result.step_way = sim->step_way();
  const ParallelFor parallel_for(device, 0, stream);
  std::optional<EveryOutput> output;
  std::vector<GameObserver*> observers;
  if (!options.nothing_stored) observers = {&output.emplace(*sim)};
  Game game(*sim, parallel_for, {everywhere(std::move(team0), *sim), everywhere(std::move(team1), *sim)}, observers);
  game.start();
  int64_t steps_made = 0;
  measure(
      options,
      [&](int64_t n) {
        const int64_t at_once = n % kPlaySteps == 0 ? kPlaySteps : n;  // plays of one length are recorded
        for (int64_t left = n; left > 0; left -= at_once) game.play(at_once);
        sim->synchronize();
        steps_made += n;
        return Work{static_cast<double>(sim->agents_per_step()) * static_cast<double>(n), 0, 0};
      },
      result, device.is_cuda() ? kPlaySteps : 1);  // a CPU records nothing
  if (!game.refusal().empty())
    result.step_way += cat(result.step_way.empty() ? "" : "; ", "queued one by one: ", game.refusal());
  result.memory_bytes = memory_in_use(device) - memory_before;

  // The proof: episodes ended and began anew; the last observations are numbers and not all the same.
  const EpisodeStats stats = sim->take_stats();
  result.checks = {{"episodes_ended", stats[EpisodeStat::episodes]},
                   {"worlds_reset", static_cast<double>(worlds_reset(*sim, steps_made))},
                   {"steps", static_cast<double>(steps_made)}};
  if (!output) return result;
  double sum = 0, squares = 0, image_sum = 0;
  for (int team = 0; team < kNTeams; ++team) {
    if (sim->params().resolution > 0)
      for (const uint8_t byte : output->some_images(team, sim->memory())) image_sum += static_cast<double>(byte);
    for (const float x : output->obs(team)) {
      sum += static_cast<double>(x);
      squares += static_cast<double>(x) * static_cast<double>(x);
    }
  }
  const bool images_only = sim->params().images_only;
  const double agents = static_cast<double>(sim->agents_per_step());
  const double numbers = images_only ? 0 : agents * run.spec.observation_size();
  result.checks.emplace_back("observations_written", numbers * static_cast<double>(steps_made));
  result.checks.emplace_back("last_observation_sum", sum);
  result.checks.emplace_back("last_observation_square_sum", squares);
  if (sim->params().resolution > 0) {
    result.checks.emplace_back("images_written", agents * static_cast<double>(steps_made));
    result.checks.emplace_back("some_last_images_sum", image_sum);
  }
  if (!std::isfinite(sum) || !(squares > 0 || images_only) || (images_only && !(image_sum > 0)))
    throw Error("the benchmark is void: observations are not finite, or all zero");
  return result;
}

/// Bytes of an agent-step that no simulator can do without: what changes at each step read and written, the action
/// read, the outputs written where they are.
double least_bytes(const SimSpec& spec, Pairs how, bool nothing_stored) {
  const int n = spec.params.n_agents;
  double state = 0;
  const WorldView none{};
  for_each_field([&](auto field, auto member) {
    const bool pairs = field.per == Per::pair || field.per == Per::agent_words;
    if constexpr (field.working)
      if (!pairs || !finds_by_place(spec, {.pairs = how}))  // else lists that may be empty
        state += static_cast<double>(field.count(n)) * static_cast<double>(sizeof(*(none.*member)));
  });
  const double action = spec.params.actions == ActionKind::discrete ? sizeof(int32_t) : kActionSize * sizeof(float);
  const double row = spec.params.images_only ? 0 : spec.observation_size() * sizeof(float);
  const double outputs = row + image_bytes(spec.params.resolution) + sizeof(float) + 1;  // reward, alive
  return 2 * state / n + action + (nothing_stored ? 0 : outputs);
}

}  // namespace

BenchResult bench_sim(const BenchOptions& options, Device device, int worlds) {
  const LoadedRun run = bench_run(options, worlds);
  const std::shared_ptr<TeamController> random = script_controller(Scripted::random);  // of both teams: one launch
  BenchResult result = play(options, device, run, random, random);
  result.bytes = least_bytes(run.spec, options.pairs, options.nothing_stored);
  if (device.is_cuda()) result.copy_rate = cuda_copy_rate(device.index);
  result.arithmetic = FieldCodec<Precision>::print(Precision::fp32);
  return result;
}

BenchResult bench_closed_loop(const BenchOptions& options, Device device, int worlds) {
  return bench_closed_loop(options, device, bench_run(options, worlds));
}

BenchResult bench_closed_loop(const BenchOptions& options, Device device, const LoadedRun& run) {
  set_up_libtorch(run.config.train, device);  // whatever a measurement before this one left
  Actor actor0 = make_actor(run, 0, device), actor1 = make_actor(run, 1, device);
  const std::shared_ptr<TeamController> both = policies_controller(actor0, actor1);
  BenchResult result = play(options, device, run, both, both);
  result.arithmetic = arithmetic_of(run, device);
  return result;
}

}  // namespace giga
