#include "parity/emulated_simulator.hpp"

#include <algorithm>
#include <cstring>
#include <map>
#include <memory>
#include <vector>

#include "core/error.hpp"
#include "cuda/draw.hpp"
#include "cuda/grid_executor.hpp"
#include "parity/odd_scenarios.hpp"
#include "sim/usual_params.hpp"

namespace giga::test {
namespace {

constexpr int kPoison = 0xFF;
constexpr size_t kSharedGuardBytes = 64;  // behind the shared memory of a block

/// Looks whether a block has kept to its shared memory, behind which lies the guard.
void check_guard(const char* shared, size_t bytes, int block) {
  const char* guard = shared + bytes;
  GIGA_CHECK(std::count(guard, guard + kSharedGuardBytes, static_cast<char>(kPoison)) == kSharedGuardBytes, "block ",
             block, " wrote beyond its ", bytes, " bytes of shared memory");
}

struct EmulatedSync {
  LockstepThreads* threads;
  void wait() const { threads->wait(); }
  // All threads of the group come to those of their block and of their warp too.
  EmulatedSync of_block() const { return *this; }
  void wait_for_warp() const { threads->wait(); }
  bool any(bool flag) const { return threads->any(flag); }
  bool any_of_warp(bool flag) const { return threads->any(flag); }
  void before_sending() const {}
  void send(float* to, const float* from, int count) const {
    GIGA_CHECK(
        reinterpret_cast<uintptr_t>(to) % 16 == 0 && reinterpret_cast<uintptr_t>(from) % 16 == 0 && count % 4 == 0,
        "the GPU cannot send this");
    std::copy(from, from + count, to);
  }
  void wait_sent() const {}
  void wait_delivered() const {}
};

/// Calls f with the parameters of an odd scenario as constants, as a GPU compiles them.
template <class F>
void with_odd_params(const SimParams& p, F&& f) {
  [&]<size_t... kAt>(std::index_sequence<kAt...>) { with_params_as<FixedParams<kOddScenarios[kAt].values>...>(p, f); }
  (std::make_index_sequence<std::size(kOddScenarios)>{});
}

class EmulatedSimulator final : public LaunchingSimulator {
 public:
  EmulatedSimulator(SimSpec spec, const SimOptions& options, ThreadOrder order)
      : LaunchingSimulator(std::move(spec), options, host_memory()),
        order_(order),
        compiled_(options.compile_step == CompileStep::always),
        step_shape_(compiled_ ? fixed_shape(params(), n_worlds()) : shape(true)),
        threads_(shape(false).threads),
        step_threads_(step_shape_.threads),
        draw_threads_(params().resolution > 0 ? kWarp : 0),
        shared_(host_memory(),
                kSharedGuardBytes + std::max({step_shape_.shared_bytes, shape(false).shared_bytes, draw_bytes()})) {}

  bool over() override { return n_lists() > 0 && *n_playing() == 0; }
  void redraw(const Redraw& request) override {
    const DrawShape s = redraw_shape(params(), request);
    const EmulatedSync sync{&draw_threads_};
    for (int block = 0; block < s.blocks; ++block)
      with_shared(block, s.shared_bytes, [&](char* shared) {
        draw_threads_.run(kWarp, order_, [&](int thread) {
          run_redraw_thread(params(), request, s, {block, s.blocks, thread, kWarp}, shared, sync);
        });
      });
  }
  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }
  std::string step_way() const override {
    bool fixed = false;
    if (compiled_) with_odd_params(params(), [&]<class P>(const P&) { fixed = P::kTeam > 0; });
    return fixed ? "a kernel for this scenario" : "";
  }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const Launch k = launch_of(io, worlds);
    for (const Job job : jobs)
      with_job(job, [&](auto constant) {
        constexpr Job kJob = decltype(constant)::value;
        if constexpr (kJob == Job::draw || kJob == Job::draw_final)
          draw<kJob>(k);
        else
          launch<kJob>(k);
      });
  }

  // From the last to the first: any order will do.
  void list_playing() override {
    *n_playing() = 0;
    for (int32_t world = n_worlds() - 1; world >= 0; --world)
      if (state_.view().phase[world] == Phase::plays) playing()[(*n_playing())++] = world;
  }

 private:
  template <Job job>
  void launch(const Launch& k) {
    constexpr bool kStep = job == Job::step;
    const LaunchShape& s = kStep ? step_shape_ : shape(false);
    LockstepThreads& threads = kStep ? step_threads_ : threads_;
    const EmulatedSync sync{&threads};
    if (k.scratch) std::memset(k.scratch, kPoison, global_scratch_bytes(params(), n_worlds()));
    for (int block = 0; block < s.blocks; ++block)
      with_shared(block, s.shared_bytes, [&](char* shared) {
        threads.run(s.group, order_, [&](int thread) {
          const ThreadIndex at{block, s.blocks, thread, s.threads};
          const auto run_tile = [&](const auto& p) { run_tile_thread<job>(k.with(p, s), at, shared, sync); };
          if (s.tiles) {
            if constexpr (kStep)
              if (compiled_) return with_odd_params(k.params, run_tile);
            with_usual_params<kStep>(k.params, run_tile);
          } else if (s.in_shared)
            run_block_thread<job, true>(k, at, shared, sync);
          else
            run_block_thread<job, false>(k, at, shared, sync);
        });
      });
  }

  // With fewer threads in a block than the GPU has: any number does the same work, and fibers are slow.
  template <Job job>
  void draw(const Launch& k) {
    const DrawShape s = draw_shape(params(), n_worlds());
    const EmulatedSync sync{&draw_threads_};
    for (int block = 0; block < s.blocks; ++block)
      with_shared(block, s.shared_bytes, [&](char* shared) {
        draw_threads_.run(kWarp, order_, [&](int thread) {
          run_draw_thread<job>(k, s, {block, s.blocks, thread, kWarp}, shared, sync);
        });
      });
  }
  size_t draw_bytes() const { return params().resolution > 0 ? draw_shape(params(), n_worlds()).shared_bytes : 0; }

  /// Runs a block with its shared memory, and looks whether it kept to that.
  template <class F>
  void with_shared(int block, size_t bytes, F&& run_threads) {
    char* shared = shared_.data();
    std::memset(shared, kPoison, bytes + kSharedGuardBytes);
    run_threads(shared);
    check_guard(shared, bytes, block);
  }

  ThreadOrder order_;
  bool compiled_;
  LaunchShape step_shape_;
  LockstepThreads threads_, step_threads_, draw_threads_;
  Buffer<char> shared_;  // of the block that runs, then the guard
};

/// With blocks of a warp: any number of threads does the same work, and fibers are slow.
class EmulatedGridSimulator final : public GridLaunchingSimulator {
 public:
  EmulatedGridSimulator(SimSpec spec, const SimOptions& options, ThreadOrder order, int blocks)
      : GridLaunchingSimulator(std::move(spec), options, host_memory(),
                               {kWarp, blocks, 1, sorted_bytes(blocks), in_parts_from(blocks)}),
        order_(order) {}

  using GridLaunchingSimulator::launches;
  bool over() override { return n_lists() > 0 && *n_playing() == 0; }
  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }
  void synchronize() override { check_full_lists(); }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const GridLaunch k = launch_of(io, worlds);
    for (const Job job : jobs)
      with_job(job, [&](auto constant) {
        constexpr Job kJob = decltype(constant)::value;
        if constexpr (kJob != Job::draw && kJob != Job::draw_final) launch<kJob>(k);
      });
  }

  void list_playing() override {
    *n_playing() = 0;
    for (int32_t world = n_worlds() - 1; world >= 0; --world)
      if (state_.view().phase[world] == Phase::plays) playing()[(*n_playing())++] = world;
  }

 private:
  template <Job job>
  void launch(const GridLaunch& k) {
    std::memset(k.scratch, kPoison, scratch().bytes());
    if constexpr (job == Job::step)
      with_plain_crowd(k, lanes_of_agent(), [&](const auto& plain, auto lanes) {
        if (launches() != StepLaunches::one)
          step_in_parts<decltype(lanes)::value>(plain);
        else
          run_blocks<true>(plain, shared_bytes(), [](const auto& all, const auto&... thread) {
            run_grid_thread<job, decltype(lanes)::value>(all, thread...);
          });
      });
    else
      run_blocks<true>(k, shared_bytes(),
                       [](const GridLaunch& all, const auto&... thread) { run_grid_thread<job, 1>(all, thread...); });
  }
  template <int kCrew, class P>
  void step_in_parts(const GridLaunchOf<P>& k) {
    for_launches<kCrew>(
        k,
        [&]<StepPart part>() {
          run_blocks<true>(k, shared_bytes(),
                           [](const auto& all, const auto&... thread) { run_grid_part<part, kCrew>(all, thread...); });
        },
        [&]<StepPart part, int kLanes, bool>(const GridLaunchOf<P>& of, int threads_of_agent, int more) {
          run_blocks<false>(
              free_part_launch(of, kWarp, threads_of_agent, more), free_part_bytes(part, kLanes, kWarp),
              [](const auto& all, const auto&... thread) { run_grid_part<part, kLanes>(all, thread...); });
        });
  }
  /// `bytes`: of shared memory, of a block; looks whether all keep to that. kTogether: blocks of a group share their
  /// barriers; else those of a block, which is a warp, are its own.
  template <bool kTogether, class P, class F>
  void run_blocks(const GridLaunchOf<P>& k, size_t bytes, F&& f) {
    const int blocks = k.blocks;
    auto& threads = threads_[blocks];
    if (!threads) threads = std::make_unique<LockstepThreads>(blocks * kWarp);
    const EmulatedSync sync{threads.get()};
    const size_t pitch = ((bytes + 63) & ~size_t{63}) + kSharedGuardBytes;
    std::vector<char> shared(pitch * static_cast<size_t>(blocks), static_cast<char>(kPoison));
    for (int group = 0; group < k.groups; ++group)
      threads->run(kTogether ? blocks * kWarp : kWarp, order_, [&](int thread) {
        const ThreadIndex at{group * blocks + thread / kWarp, k.groups * blocks, thread % kWarp, kWarp};
        f(k, at, sync, shared.data() + pitch * static_cast<size_t>(thread / kWarp));
      });
    for (int block = 0; block < blocks; ++block)
      check_guard(shared.data() + pitch * static_cast<size_t>(block), bytes, block);
  }
  /// Room for sorted agents: those of a GPU of two blocks, kBlocksInParts or kBlocksForMore sort together, all others
  /// for themselves where there is room.
  static size_t sorted_bytes(int blocks) {
    return blocks == 2 || blocks == kBlocksInParts || blocks == kBlocksForMore ? 0 : size_t{1} << 16;
  }
  static int in_parts_from(int blocks) {
    return blocks == kBlocksInParts ? 1 : blocks == kBlocksToSpare || blocks == kBlocksForMore ? 1 << 16 : 0;
  }

  ThreadOrder order_;
  std::map<int, std::unique_ptr<LockstepThreads>> threads_;  // of groups of so many blocks
};

}  // namespace

std::unique_ptr<Simulator> make_emulated_grid_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order,
                                                        int blocks) {
  return std::make_unique<EmulatedGridSimulator>(std::move(spec), options, order, blocks);
}

StepLaunches emulated_launches(SimSpec spec, const SimOptions& options, int blocks) {
  return EmulatedGridSimulator(std::move(spec), options, ThreadOrder::forward, blocks).launches();
}

std::unique_ptr<Simulator> make_emulated_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order) {
  return std::make_unique<EmulatedSimulator>(std::move(spec), options, order);
}

}  // namespace giga::test
