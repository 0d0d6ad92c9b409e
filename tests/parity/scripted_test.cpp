// Scripted teams on CPU and GPU, bit for bit, on observations of random worlds.
#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <set>
#include <vector>

#include "config/fields.hpp"
#include "core/parallel_for.hpp"
#include "cuda/runtime.hpp"
#include "scripted/actions.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_runner.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

constexpr int kWorlds = 33, kVariants = 24;

/// What both teams of a random scenario see after some steps with random actions, and what a script makes of it.
class Decisions {
 public:
  explicit Decisions(int variant) : spec_(random_spec(static_cast<uint64_t>(variant), 4, 3)) {
    set_switches(spec_, static_cast<unsigned>(variant * 37) % kNSwitchMasks);
    spec_.finish();
    SimOptions options;
    options.n_worlds = kWorlds;
    options.seed = 9 + static_cast<uint64_t>(variant);
    sim_ = make_cpu_simulator(spec_, options);
    StepIo io;
    for (int team = 0; team < kNTeams; ++team) {
      const auto t = static_cast<size_t>(team);
      obs_[t].resize(rows(team) * static_cast<size_t>(columns()));
      io.team[team].obs[Observation::vector].rows = obs_[t].data();
    }
    sim_->start(io);
    for (uint64_t step = 0; step < 12; ++step) {
      std::vector<uint8_t> action[kNTeams];
      for (int team = 0; team < kNTeams; ++team) {
        action[team] = random_actions(spec_, team, kWorlds, 100 * step + static_cast<uint64_t>(team));
        io.team[team].action = action[team].data();
      }
      sim_->step(io);
    }
  }

  /// The action buffer of a team as a device fills it, poisoned before.
  std::vector<float> play(Scripted script, int team, Device device) const {
    Memory& memory = device.is_cuda() ? cuda_memory(device.index) : host_memory();
    const SimTables tables(spec_, memory);
    const StateView& state = sim_->state().view();
    const Buffer<float> obs(memory, obs_[static_cast<size_t>(team)]);
    const Buffer<uint32_t> steps(memory, std::vector<uint32_t>(state.draw_step, state.draw_step + kWorlds));
    const Buffer<int32_t> ages(memory, std::vector<int32_t>(state.episode_length, state.episode_length + kWorlds));
    Buffer<float> action(memory, std::vector<float>(rows(team) * kActionSize, 77.0f));
    const RowDraws draws{steps.data(), 5, 0, spec_.params.n_team[team], team};
    const ParallelFor parallel_for(device, 1);
    parallel_for.run(ScriptedActions{script, spec_.params.actions, draws, ages.data(), action.data(), tables.params(),
                                     obs.data(), columns()},
                     static_cast<int64_t>(rows(team)));
    return action.to_host();
  }

 private:
  int columns() const { return VectorObservation::shape(spec_.params).size(); }
  size_t rows(int team) const { return static_cast<size_t>(kWorlds * spec_.params.n_team[team]); }

  SimSpec spec_;
  std::unique_ptr<Simulator> sim_;
  std::vector<float> obs_[kNTeams];
};

const size_t kNScripts = FieldCodec<Scripted>::names().size();

TEST(GpuScripted, DecidesAsTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "skipped: no GPU";
  for (int variant = 0; variant < kVariants; ++variant) {
    const Decisions decisions(variant);
    for (size_t script = 0; script < kNScripts; ++script)
      for (int team = 0; team < kNTeams; ++team) {
        const auto kind = static_cast<Scripted>(script);
        const std::vector<float> cpu = decisions.play(kind, team, Device{});
        const std::vector<float> gpu = decisions.play(kind, team, parse_device("cuda:0"));
        ASSERT_EQ(cpu.size(), gpu.size());
        for (size_t k = 0; k < cpu.size(); ++k)
          ASSERT_EQ(std::memcmp(&cpu[k], &gpu[k], sizeof(float)), 0)
              << name_of(kind) << ", variant " << variant << ", team " << team << ", number " << k << ": CPU " << cpu[k]
              << ", GPU " << gpu[k];
      }
  }
}

TEST(Scripted, TheWorldsOfTheComparisonBringDifferentDecisions) {
  for (size_t script = static_cast<size_t>(Scripted::pursuer); script < kNScripts; ++script) {
    std::set<float> numbers;
    for (int variant = 0; variant < kVariants; ++variant)
      for (const float x : Decisions(variant).play(static_cast<Scripted>(script), 0, Device{})) numbers.insert(x);
    EXPECT_GT(numbers.size(), 20u) << name_of(static_cast<Scripted>(script));
  }
}

}  // namespace
}  // namespace giga::test
