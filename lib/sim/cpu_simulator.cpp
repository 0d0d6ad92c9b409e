// The CPU back end: worlds in parallel over threads, each stepped by one worker.
#include <algorithm>

#include "core/thread_pool.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"

namespace giga {
namespace {

class CpuSimulator final : public Simulator {
 public:
  CpuSimulator(SimSpec spec, const SimOptions& options)
      : Simulator(std::move(spec), options, host_memory()), layout_(params()), pool_(options.n_threads) {
    scratch_.resize(static_cast<size_t>(pool_.n_threads()));
    for (auto& block : scratch_) block = Buffer<char>(host_memory(), layout_.size);
  }

  void start(const StepIo& io) override {
    for_worlds([&](WorldView& w, PhiloxDraws& draws, int64_t world) {
      start_world(SerialLanes{}, params(), w, draws, io, world);
    });
  }

  void step(const StepIo& io) override {
    for_worlds([&](WorldView& w, PhiloxDraws& draws, int64_t world) {
      if (options_.episodes == 1) return play_step(SerialLanes{}, params(), w, draws, io, options_.on_done, world);
      step_world(SerialLanes{}, params(), w, draws, io, options_.on_done, world);
      if (to_settle(SerialLanes{}, w))
        play_on(
            SerialLanes{}, params(), w, [&](uint32_t step) { return draws_of(world, step); }, io, world,
            options_.episodes);
    });
  }

  void observe(const StepIo& io) override {
    for_worlds(
        [&](WorldView& w, PhiloxDraws&, int64_t world) { write_observations(SerialLanes{}, params(), w, io, world); });
  }

  bool over() override {
    const Phase* phase = state_.view().phase;
    return std::all_of(phase, phase + n_worlds(), [](Phase p) { return p == Phase::waits; });
  }

  EpisodeStats take_stats() override {
    EpisodeStats sums;
    float* stats = state_.view().stats;
    for (int64_t world = 0; world < n_worlds(); ++world) {
      float* row = stats + world * kNStatRows;
      for (int k = 0; k < kNStatRows; ++k) {
        sums.rows[static_cast<size_t>(k)] += static_cast<double>(row[k]);
        row[k] = 0;
      }
    }
    return sums;
  }

 private:
  PhiloxDraws draws_of(int64_t world, uint32_t step) const {
    return {options_.seed, draw_world(options_.first_world, options_.draw_period, world), step};
  }

  template <class F>
  void for_worlds(F&& f) {
    pool_.for_ranges(n_worlds(), [&](int64_t begin, int64_t end, int thread) {
      for (int64_t world = begin; world < end; ++world) {
        WorldView w = world_view(state_.view(), params(), world);
        attach_scratch(w, layout_, scratch_[static_cast<size_t>(thread)].data());
        PhiloxDraws draws = draws_of(world, *w.draw_step);
        f(w, draws, world);
      }
    });
  }

  ScratchLayout layout_;
  ThreadPool pool_;
  std::vector<Buffer<char>> scratch_;  // by thread
};

}  // namespace

std::unique_ptr<Simulator> make_cpu_simulator(SimSpec spec, const SimOptions& options) {
  return std::make_unique<CpuSimulator>(std::move(spec), options);
}

}  // namespace giga
