#include "parity/emulated_simulator.hpp"

#include <algorithm>
#include <cstring>

#include "core/error.hpp"
#include "cuda/executor.hpp"

namespace giga::test {
namespace {

constexpr int kPoison = 0xFF;
constexpr size_t kSharedGuardBytes = 64;  // behind the shared memory of a block

struct EmulatedSync {
  LockstepThreads* threads;
  void wait() const { threads->wait(); }
  bool any(bool flag) const { return threads->any(flag); }
};

class EmulatedSimulator final : public LaunchingSimulator {
 public:
  EmulatedSimulator(SimSpec spec, const SimOptions& options, ThreadOrder order)
      : LaunchingSimulator(std::move(spec), options, host_memory()),
        order_(order),
        threads_(shape().threads),
        shared_(host_memory(), shape().shared_bytes + kSharedGuardBytes) {}

  bool over() override { return n_lists() > 0 && *n_playing() == 0; }
  EpisodeStats take_stats() override { return take_host_stats(state_.view(), n_worlds()); }

 protected:
  void run(const Jobs& jobs, const StepIo& io, Worlds worlds) override {
    const Launch k = launch_of(io, worlds);
    for (const Job job : jobs) with_job(job, [&](auto constant) { launch<decltype(constant)::value>(k); });
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
    const LaunchShape& s = shape();
    const EmulatedSync sync{&threads_};
    char* shared = shared_.data();
    if (k.scratch) std::memset(k.scratch, kPoison, global_scratch_bytes(params(), n_worlds()));
    for (int block = 0; block < s.blocks; ++block) {
      std::memset(shared, kPoison, shared_.size());
      threads_.run(s.tiles ? kWarp : s.threads, order_, [&](int thread) {
        const ThreadIndex at{block, s.blocks, thread, s.threads};
        if (s.tiles)
          run_tile_thread<job>(k, at, shared, sync);
        else if (s.in_shared)
          run_block_thread<job, true>(k, at, shared, sync);
        else
          run_block_thread<job, false>(k, at, shared, sync);
      });
      const char* guard = shared + s.shared_bytes;
      GIGA_CHECK(std::count(guard, guard + kSharedGuardBytes, static_cast<char>(kPoison)) == kSharedGuardBytes,
                 "block ", block, " wrote beyond its ", s.shared_bytes, " bytes of shared memory");
    }
  }

  ThreadOrder order_;
  LockstepThreads threads_;
  Buffer<char> shared_;  // of the block that runs, then the guard
};

}  // namespace

std::unique_ptr<Simulator> make_emulated_simulator(SimSpec spec, const SimOptions& options, ThreadOrder order) {
  return std::make_unique<EmulatedSimulator>(std::move(spec), options, order);
}

}  // namespace giga::test
