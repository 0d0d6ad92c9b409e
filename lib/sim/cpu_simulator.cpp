// The CPU back end: worlds in parallel over threads, each stepped by one worker.
#include <algorithm>

#include "core/error.hpp"
#include "core/thread_pool.hpp"
#include "sim/draws.hpp"
#include "sim/lanes.hpp"
#include "sim/simulator.hpp"
#include "sim/step.hpp"
#include "sim/usual_params.hpp"

namespace giga {
namespace {

class CpuSimulator final : public Simulator {
 public:
  CpuSimulator(SimSpec spec, const SimOptions& options)
      : Simulator(std::move(spec), with_pairs(options, Pairs::tables), host_memory()),
        layout_(params()),
        pool_(options.n_threads) {
    scratch_.resize(static_cast<size_t>(pool_.n_threads()));
    for (auto& block : scratch_) block = Buffer<char>(host_memory(), layout_.size);
  }

  void redraw(const Redraw& request) override {
    const SimParams& p = params();
    pool_.for_ranges(request.count * p.n_team[request.team], [&](int64_t begin, int64_t end, int thread) {
      WorldView w{};
      attach_scratch(w, layout_, scratch_[static_cast<size_t>(thread)].data());
      for (int64_t k = begin; k < end; ++k) {
        const ImageRows image{request.images + k * image_bytes(p.resolution), p.resolution, 0, p.resolution,
                              p.original()};
        redraw_image(SerialLanes{}, p, request, k, image, marks_of(w));
      }
    });
  }

  bool over() override {
    const Phase* phase = state_.view().phase;
    return std::all_of(phase, phase + n_worlds(), [](Phase p) { return p == Phase::waits; });
  }

  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const bool listed = worlds == Worlds::listed;
    const int64_t count = listed ? static_cast<int64_t>(playing_.size()) : n_worlds();
    with_params_as<UsualParams<5>, UsualParams<2>>(params(), [&](const auto& p) {
      pool_.for_ranges(count, [&](int64_t begin, int64_t end, int thread) {
        char* scratch = scratch_[static_cast<size_t>(thread)].data();
        for (int64_t k = begin; k < end; ++k) {
          const int64_t world = listed ? playing_[static_cast<size_t>(k)] : k;
          WorldView w = world_view(state_.view(), p.n_agents, world);
          attach_scratch(w, layout_, scratch);
          const uint32_t number = draw_world(options_.first_world, options_.draw_period, world);
          const auto draws_at = [&](uint32_t step) { return PhiloxDraws(options_.seed, number, step); };
          run_jobs(SerialLanes{}, jobs, p, w, draws_at, io, ending(), world);
        }
      });
    });
  }

  void list_playing() override {
    playing_.clear();
    for (int64_t world = 0; world < n_worlds(); ++world)
      if (state_.view().phase[world] == Phase::plays) playing_.push_back(world);
  }

 private:
  ScratchLayout layout_;
  ThreadPool pool_;
  std::vector<Buffer<char>> scratch_;  // by thread
  std::vector<int64_t> playing_;       // worlds of the last list
};

}  // namespace

std::unique_ptr<Simulator> make_cpu_simulator(SimSpec spec, const SimOptions& options) {
  GIGA_CHECK(spec.params.n_agents <= kMaxAgents, spec.params.n_agents, " agents with tables of pairs");
  return std::make_unique<CpuSimulator>(std::move(spec), options);
}

}  // namespace giga
