// Learning from images: what an update draws again is what was acted on, and what only an image tells is learned.
#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <tuple>
#include <vector>

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "learn/libtorch_settings.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "learn/memory.hpp"
#include "learn/team_policy.hpp"
#include "rollout/policy_controllers.hpp"
#include "runs.hpp"
#include "sim/image_rows.hpp"
#include "sim/state_observation.hpp"

namespace giga::test {
namespace {

constexpr const char* kSmallImages = "observation: {type: rgb, resolution: 16}\n";

/// Images of 16 x 16 for the actors, the true state for their critics.
SmallRun pixel_run(const std::string& scenario = kSmallImages) {
  SmallRun run;
  run.actor = "encoder: impala, impala_width: 4, hidden: [16], activation: relu";
  run.critic = "kind: state, hidden: [16, 16]";
  run.scenario = scenario;
  run.n_threads = 1;
  return run;
}

/// Copies the images of team 1 that each step of a rollout is acted on.
class ImageWitness final : public GameObserver {
 public:
  void before_step(int64_t t, GameStep& step) override {
    if (t >= 0) before_ = step.team[1].image;
  }
  void after_step(int64_t t, const GameStep& step) override {
    const auto* written = static_cast<const uint8_t*>(step.io.team[1].obs[Observation::image].rows);
    EXPECT_TRUE(t < 0 || before_ == written) << "one buffer serves all steps";
    const SimParams& p = step.sim->params();
    const int64_t size = int64_t{step.sim->n_worlds()} * p.n_team[1] * image_bytes(p.resolution);
    seen.push_back(
        at::from_blob(const_cast<uint8_t*>(written), {step.sim->n_worlds(), size / step.sim->n_worlds()}, at::kByte)
            .clone());
  }
  std::vector<at::Tensor> seen;  // after each start and step: [W, n R R 3]

 private:
  const uint8_t* before_ = nullptr;
};

// Three rollouts of 8 steps in episodes of 11, so that episodes end and begin inside of them; obstacles, waypoints, and
// teams of three and two.
TEST(LearnPixels, RedrawnImagesAreThoseThatWereActedOn) {
  const LoadedRun run = pixel_run(cat(kSmallImages,
                                      "max_episode_length: 11\nmaps: all\nwaypoints: {enable_waypoints: true}\n"
                                      "limit_x: 10\nlimit_y: 10\nteam_0: [{type: default, count: 3}]\n"))
                            .load();
  const ParallelFor parallel_for(Device{}, 2);
  const Actor actors[] = {make_actor(run, 0, {}), make_actor(run, 1, {})};
  constexpr int kWorlds = 7, kHorizon = 8;
  const auto sim = make_cpu_simulator(run.spec, {kWorlds, 17, 0, OnDone::reset, 2});
  Collector collector(*sim, parallel_for, {.horizon = kHorizon, .desynchronize = true, .with_final_images = true},
                      {everywhere(policy_controller(actors[0]), *sim), everywhere(policy_controller(actors[1]), *sim)});
  ImageWitness witness;
  collector.watch(witness);
  collector.start();
  int ended = 0, truncated = 0;
  for (int rollout = 0; rollout < 3; ++rollout) {
    collector.collect();
    const Rollout& r = collector.rollout();
    EXPECT_FALSE(r.team[1].obs.defined()) << "nobody reads numbers";
    ASSERT_EQ(r.images.states.sizes(), at::IntArrayRef({kHorizon + 1, kWorlds, r.images.states.size(2)}));
    // witness.seen[k] was written by the start (k = 0) or by step k - 1.
    for (int t = 0; t <= kHorizon; ++t) {
      const at::Tensor drawn = r.images.draw(1, r.images.states[t]);
      ASSERT_TRUE(at::equal(drawn.flatten(1), witness.seen[static_cast<size_t>(rollout * kHorizon + t)]))
          << "rollout " << rollout << ", slot " << t;
    }
    // A minibatch: states in any order, numbered step by step. State 3 x 7 + 5 is world 5 at step 3.
    const at::Tensor states = at::tensor({26, 0, 55, 26}, at::kLong);
    const at::Tensor some = r.images.draw(1, r.images.states.flatten(0, 1), states);
    const auto size_3 = static_cast<size_t>(rollout * kHorizon + 3),
               size_7 = static_cast<size_t>(rollout * kHorizon + 7);
    EXPECT_TRUE(at::equal(some[0].flatten(), witness.seen[size_3][5]));
    EXPECT_TRUE(at::equal(some[2].flatten(), witness.seen[size_7][6]));
    EXPECT_TRUE(at::equal(some[0], some[3]));
    EXPECT_FALSE(at::equal(some[0], some[1]));
    // The last image of an episode that was cut off is not that of the next one's beginning.
    const at::Tensor last = r.images.draw(1, r.images.final_states);
    for (int w = 0; w < kWorlds; ++w)
      for (int t = 0; t < kHorizon; ++t) {
        const auto done = static_cast<Done>(r.done[t][w].item<uint8_t>());
        ended += done != Done::running ? 1 : 0;
        if (done != Done::truncated) continue;
        ++truncated;
        EXPECT_FALSE(at::equal(last[w].flatten(), witness.seen[static_cast<size_t>(rollout * kHorizon + t + 1)][w]));
        EXPECT_GT(last[w].sum().item<int64_t>(), 0);
      }
  }
  EXPECT_GE(ended, 7) << "24 steps in 7 worlds whose episodes have at most 11";
  EXPECT_GT(truncated, 0);
}

/// The reward of an action says whether its index is below 13, where the agent is in the left half of the map, or
/// above, where it is in the right half. Only the image says where the agent is. Expects that an actor learns it; by
/// chance half of the actions are right.
void expect_learns_sides(const std::string& critic) {
  SmallRun small = pixel_run("observation: {type: rgb, resolution: 12}\n");
  small.critic = critic;
  small.mappo = "gamma: 0, gae_lambda: 0, schedule: constant, learning_rate: 5.0e-3, entropy_coef: 0";
  const LoadedRun run = small.load();
  set_up_libtorch(run.config.train, Device{});  // one thread: the seed always learns the same
  const ParallelFor parallel_for(Device{}, 1);
  const auto sim = make_cpu_simulator(run.spec, {run.config.train.n_worlds, 5, 0, OnDone::reset, 1});
  PpoTeam team(run, 0, Device{}, parallel_for, {{0, sim->n_worlds()}, sim->n_worlds()});
  Collector collector(
      *sim, parallel_for,
      {.horizon = 8,
       .with_state = true,
       .desynchronize = true,
       .keep = team.reads(),
       .with_final_images = team.critic_reads_image()},
      {everywhere(policy_controller(team.actor()), *sim), everywhere(script_controller(Scripted::random), *sim)});
  collector.start();
  StepSettings settings = StepSettings::of(run.config.mappo);
  settings.actor_step_size = settings.critic_step_size = 5e-3f;
  team.set(settings);
  at::Generator order = at::detail::createCPUGenerator(5);  // the default one is seeded by the clock
  const auto share_right = [&](bool learns, int rollouts) {
    double right = 0, rows = 0;
    for (int k = 0; k < rollouts; ++k) {
      collector.collect();
      const Rollout& rollout = collector.rollout();
      const TeamRollout& r = rollout.team[0];
      const at::Tensor agents = rollout.true_state.slice(0, 0, 8)
                                    .slice(2, 0, 2 * kEntityFeatures)
                                    .view({8, sim->n_worlds(), 2, kEntityFeatures});
      const at::Tensor is_right = (r.action > 13) == (agents.select(-1, 1) > 0.5);
      r.reward.copy_(is_right);
      const at::Tensor alive = r.alive.slice(0, 0, 8) != 0;
      right += (is_right & alive).sum().item<double>();
      rows += alive.sum().item<double>();
      if (!learns) continue;
      team.compute_advantages(rollout);
      int minibatch = 0;
      for (int epoch = 0; epoch < 2; ++epoch) {
        team.begin_epoch(rollout, at::randperm(team.n_sequences(), order, at::kLong));
        for (int m = 0; m < 4; ++m) team.update_minibatch(rollout, m, ++minibatch);
        team.end_epoch();
      }
    }
    return right / rows;
  };
  const double before = share_right(false, 3);
  share_right(true, 18);  // 12 come to 0.75 to 0.83, by the CPU
  const double after = share_right(false, 3);
  testing::Test::RecordProperty("before", std::to_string(before));
  testing::Test::RecordProperty("after", std::to_string(after));
  EXPECT_NEAR(before, 0.5, 0.1);
  EXPECT_GT(after, 0.75);
}

TEST(LearnPixels, TheActorLearnsWhatOnlyTheImageTells) { expect_learns_sides("kind: state, hidden: [16, 16]"); }
TEST(LearnPixels, ItLearnsBySharedFeaturesToo) { expect_learns_sides("shared_encoder: true, hidden: [16]"); }

// In half precision, by the kernels of the first layers and by cuDNN: a run that is loaded goes on as the one that
// saved.
TEST(LearnPixelsGpu, GoingOnIsBitForBit) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const Device gpu{Device::Kind::cuda, 0};
  const std::string images = "observation: {type: rgb}\n",
                    both = "observation: {type: rgb_vector, egocentric_view: true}\n";
  for (const auto& [encoder, scenario, mappo] : {std::tuple{"nature", images, ""},
                                                 {"compact", images, ""},
                                                 {"impala, impala_width: 8", images, ""},
                                                 {"compact", both, "view_coef: 5"}}) {
    SCOPED_TRACE(cat(encoder, " ", mappo));
    SmallRun run = pixel_run(scenario);
    run.mappo = mappo;
    run.actor = cat("encoder: ", encoder, ", hidden: [32], activation: relu");
    run.precision = "bf16";
    const auto learner = run.learner(gpu), loaded = run.learner(gpu);
    for (int u = 0; u < 2; ++u) learner->update();
    const NamedArrays checkpoint = saved(*learner);
    expect_finite(checkpoint);
    loaded->load(checkpoint);
    for (int u = 0; u < 2; ++u) EXPECT_EQ(difference(learner->update(), loaded->update()), "");
    EXPECT_EQ(difference(saved(*learner), saved(*loaded)), "");
  }
}

// A rollout keeps no image and no numbers that nobody reads, and the plan says what that saves. A world of 4 agents:
// 4 x (6 + 1) + 1 + 4 + 1 = 34 words = 136 bytes, its images 4 x 16 x 16 x 3 = 3,072; 24 worlds of 8 steps.
TEST(LearnPixels, ThePlanSaysWhatRedrawingSaves) {
  const LoadedRun run = pixel_run().load();
  const Algorithm& algorithm = algorithm_of(run.config);
  EXPECT_EQ(algorithm.redrawn(run).images, 24 * 8 * 3072);
  EXPECT_EQ(algorithm.redrawn(run).kept, 24 * 8 * 136);
  EXPECT_EQ(algorithm.least_bytes(run), static_cast<int64_t>(state_bytes(run.spec, 24)) + 24 * 8 * 136);
  SmallRun shared = pixel_run();
  shared.critic = "shared_encoder: true, hidden: [16]";  // no numbers either
  EXPECT_EQ(algorithm.redrawn(shared.load()).images, algorithm.redrawn(run).images);
  EXPECT_EQ(algorithm.least_bytes(shared.load()), algorithm.least_bytes(run));
  EXPECT_EQ(algorithm.redrawn(SmallRun{}.load()).images, 0);
  const MemoryPlan plan{algorithm.size(run.config), {{12, 1 << 20}, {24, 2 << 20}}, 0};
  EXPECT_NE(plan_text(run, kCpu, {1 << 30, 1 << 30}, plan)
                .find("the images of an update would take 576 KiB; they are drawn again from 25.5 KiB that are kept"),
            std::string::npos);
}

}  // namespace
}  // namespace giga::test
