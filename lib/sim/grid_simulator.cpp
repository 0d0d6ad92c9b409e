// Worlds of many agents on the CPU (rules 17): in parallel over threads, or, where they are few, one after the other,
// the agents of each in parallel.
#include <algorithm>
#include <utility>
#include <vector>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "sim/grid_memory.hpp"
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

class GridSimulator final : public Simulator {
 public:
  GridSimulator(SimSpec spec, const SimOptions& options)
      : Simulator(std::move(spec), with_pairs(options, Pairs::by_place), host_memory()),
        params_(grid_params(spec_, tables_, options_.most_shooters)),
        keys_(options_.seed),
        pool_(options_.n_threads),
        worlds_by_thread_(n_worlds() >= pool_.n_threads() * (params_.n_agents <= kMaxAgents ? 1 : 2)) {
    check_grid(params_, state_.shape(), options_);
    worlds_.resize(worlds_by_thread_ ? static_cast<size_t>(pool_.n_threads()) : 1);
    for (GridWorld& world : worlds_) {
      Buffer<char>& scratch = scratch_.emplace_back(host_memory(), attach_scratch(params_, world, nullptr, false));
      attach_scratch(params_, world, scratch.data(), false);
      world.full_lists = &full_lists_;
    }
  }

  void redraw(const Redraw&) override { throw Error("there are no images"); }

  std::string step_way() const override { return kByPlaceWay; }
  bool over() override {
    const Phase* phase = state_.view().phase;
    return std::all_of(phase, phase + n_worlds(), [](Phase p) { return p == Phase::waits; });
  }

  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const auto run_some = [&](const auto& lanes, const GridWorld& scratch, int64_t begin, int64_t end) {
      for (int64_t world = begin; world < end; ++world) {
        if (worlds == Worlds::listed && state_.view().phase[world] == Phase::waits) continue;
        GridWorld w = scratch;
        attach_state(params_, w, state_.view(), state_.lists(), world);
        const uint32_t number = draw_world(options_.first_world, options_.draw_period, world);
        const auto draws_at = [&](uint32_t step) { return GridDraws(keys_, number, step); };
        run_jobs(lanes, jobs, params_, w, draws_at, io, ending(), world);
      }
    };
    if (worlds_by_thread_)
      pool_.for_ranges(n_worlds(), [&](int64_t begin, int64_t end, int thread) {
        run_some(SerialLanes{}, worlds_[static_cast<size_t>(thread)], begin, end);
      });
    else
      run_some(ThreadLanes(pool_), worlds_[0], 0, n_worlds());
    if (const int full = std::exchange(full_lists_, 0); full > 0) throw full_lists_error(full, params_, spec_.name);
  }

  // Those that wait are passed over as they come.
  void list_playing() override {}

 private:
  GridParams params_;
  PhiloxKeys keys_;
  ThreadPool pool_;
  const bool worlds_by_thread_;
  std::vector<GridWorld> worlds_;      // their scratch: by thread, or of the world at hand
  std::vector<Buffer<char>> scratch_;  // of these
  int32_t full_lists_ = 0;
};

}  // namespace

std::unique_ptr<Simulator> make_grid_simulator(SimSpec spec, const SimOptions& options) {
  return std::make_unique<GridSimulator>(std::move(spec), options);
}

}  // namespace giga
