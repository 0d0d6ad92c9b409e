// Worlds of many agents on the CPU: one after the other, the agents of each in parallel over threads (rules 17).
#include <algorithm>
#include <utility>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "sim/grid_stages.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"

namespace giga {
namespace {

/// The agents of one world over the threads of the CPU; each worker sees to whole rows.
class ThreadLanes {
 public:
  static constexpr bool kSerial = true;
  explicit ThreadLanes(const ThreadPool& pool) : pool_(pool) {}

  template <class F>
  void each(int n, F&& f) const {
    if (n < kWorthThreads) return SerialLanes{}.each(n, f);
    pool_.for_ranges(n, [&f](int64_t begin, int64_t end, int) {
      for (int64_t i = begin; i < end; ++i) f(static_cast<int>(i));
    });
  }
  template <class F>
  void each_agent(int n, F&& f) const {
    each(n, f);
  }
  template <class OfRow, class F>
  void each_cell(int rows, int columns, OfRow&& of_row, F&& f) const {
    each(rows, [&](int row) {
      const auto common = of_row(row);
      for (int column = 0; common && column < columns; ++column) f(common, column);
    });
  }
  void wait_delivered() const {}
  bool any(bool flag) const { return flag; }

 private:
  static constexpr int kWorthThreads = 128;  // to start them takes as long as some dozen agents
  const ThreadPool& pool_;
};

/// What one step of a world needs besides its state.
class Scratch {
 public:
  explicit Scratch(const GridParams& p) {
    const auto n = static_cast<size_t>(p.n_agents);
    const auto take = [this](auto*& array, size_t size) {
      arrays_.emplace_back(host_memory(), size * sizeof *array);
      array = reinterpret_cast<std::remove_reference_t<decltype(array)>>(arrays_.back().data());
    };
    take(w_.dir_x, n);
    take(w_.dir_y, n);
    take(w_.taken, n);
    take(w_.reward, n);
    take(w_.next, 3 * n);
    take(w_.was_alive, n);
    take(w_.flags, n);
    take(w_.neighbor_distance, n * static_cast<size_t>(p.n_neighbors));
    take(w_.features, n);
    take(w_.terms, n * kNRewardTerms);
    take(w_.counts, kNCounts);
    take(w_.nearest_agents, p.egocentric_view ? n * kNearestAgents : 0);
    take(w_.detects, n);
    take(w_.dealt, n);
    take(w_.observers, n);
    take(w_.detectors, n * kKeptDetectors);
    take(w_.could_see, n);
    take(w_.full_lists, 1);
    take(w_.placed, n);
    take(w_.cell_begin, n + 1);
  }

  /// World number `world` of a state, with this scratch.
  GridWorld attach(const SimState& state, int64_t world) const {
    GridWorld w = w_;
    const StateShape& shape = state.shape();
    for_each_field([&](auto field, auto member) {
      const auto* all = state.view().*member;
      if (all) w.*member = state.view().*member + world * field.count(shape.n_agents);
    });
    const int64_t first = world * shape.n_agents;
    w.fire = state.lists().fire + first * shape.shooters;
    w.neighbors = reinterpret_cast<AgentNumber*>(state.lists().neighbors + first * shape.rows);
    return w;
  }
  int32_t take_full_lists() { return std::exchange(*w_.full_lists, 0); }

 private:
  std::vector<Buffer<char>> arrays_;
  GridWorld w_{};
};

GridParams grid_params(const SimSpec& spec, const SimTables& tables, int most_shooters) {
  float widest[kNTeams] = {};
  for (const AgentSpec& agent : spec.agents) widest[agent.team] = std::max(widest[agent.team], agent.range);
  return {tables.params(), widest, most_shooters};
}

class GridSimulator final : public Simulator {
 public:
  GridSimulator(SimSpec spec, const SimOptions& options)
      : Simulator(std::move(spec), options, host_memory()),
        params_(grid_params(spec_, tables_, options_.most_shooters)),
        pool_(options_.n_threads),
        scratch_(params_) {
    GIGA_CHECK(state_.shape().lists(), "a world of ", params_.n_agents, " agents without the option grid");
    GIGA_CHECK(params_.resolution == 0, "images of a world in which pairs are found by place");
    GIGA_CHECK(options_.most_shooters > 0 && options_.most_shooters <= kMostShooters, options_.most_shooters,
               " shooters");
  }

  void redraw(const Redraw&) override { throw Error("there are no images"); }

  bool over() override {
    const Phase* phase = state_.view().phase;
    return std::all_of(phase, phase + n_worlds(), [](Phase p) { return p == Phase::waits; });
  }

  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const ThreadLanes lanes(pool_);
    for (int64_t world = 0; world < n_worlds(); ++world) {
      if (worlds == Worlds::listed && state_.view().phase[world] == Phase::waits) continue;
      GridWorld w = scratch_.attach(state_, world);
      const uint32_t number = draw_world(options_.first_world, options_.draw_period, world);
      const auto draws_at = [&](uint32_t step) { return GridDraws(options_.seed, number, step); };
      run_jobs(lanes, jobs, params_, w, draws_at, io, ending(), world);
    }
    if (const int full = scratch_.take_full_lists(); full > 0)
      throw Error(
          cat(full, full == 1 ? " agent was" : " agents were", " fired at by more than ", params_.most_shooters,
              " opponents at once in scenario '", spec_.name, "': so many are counted in a world of ", params_.n_agents,
              " agents (rules 17.2); with smaller damage.damage_cone_depth or damage_cone_angle", " fewer reach it"));
  }

  // Those that wait are passed over as they come.
  void list_playing() override {}

 private:
  GridParams params_;
  ThreadPool pool_;
  Scratch scratch_;
};

}  // namespace

std::unique_ptr<Simulator> make_grid_simulator(SimSpec spec, const SimOptions& options) {
  return std::make_unique<GridSimulator>(std::move(spec), options);
}

}  // namespace giga
