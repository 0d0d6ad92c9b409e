// What an actor's encoder of images is taught beside its policy: the gradient is that of both losses, and the features
// come to tell the egocentric view.
#include "learn/mappo/view_teacher.hpp"

#include <gtest/gtest.h>
#include <torch/types.h>

#include <string>
#include <vector>

#include "learning_team.hpp"

namespace giga::test {
namespace {

/// Images of 12 x 12, and the egocentric view in numbers.
SmallRun taught_run(const std::string& view_coef) {
  SmallRun run;
  run.actor = "encoder: impala, impala_width: 4, hidden: [24], activation: relu, output_gain: 1";
  run.mappo = cat("value_norm: false, advantage_norm: none, max_grad_norm: 0, entropy_coef: 0, view_coef: ", view_coef);
  run.scenario = "observation: {type: rgb_vector, resolution: 12, egocentric_view: true}\n";
  run.n_threads = 1;
  return run;
}

/// [T W, n, V] of a rollout.
at::Tensor view_of(const LoadedRun& run, const TeamRollout& r) {
  const InputColumns columns = input_columns(NetworkInputs::egocentric, run.spec);
  return r.obs.slice(0, 0, run.config.mappo.horizon).flatten(0, 1).narrow(2, columns.first, columns.size);
}

// By LibTorch's operations: view_coef times the mean over living agents and numbers of the squared error.
TEST(LearnViewTeacher, ItsGradientIsAddedToThatOfThePolicy) {
  struct Case {
    const char *name, *critic;
    float coef;
  };
  for (const Case& k : {Case{"beside a critic of numbers", "hidden: [12], inputs: egocentric", 3},
                        Case{"beside one of the true state", "kind: state, hidden: [12, 8]", 0.5f},
                        Case{"before one that shares the encoder", "shared_encoder: true, hidden: [12]", 3}}) {
    SCOPED_TRACE(k.name);
    SmallRun small = taught_run(cat(k.coef));
    small.critic = k.critic;
    small.mappo += ", value_coef: 0";  // what is learned of values changes no encoder
    LoadedRun run = small.load();
    run.config.mappo.n_minibatches = 1;
    LearningTeam game(run);
    game.collector.collect();
    const Rollout& rollout = game.collector.rollout();
    const TeamRollout& r = rollout.team[0];
    game.team.compute_advantages(rollout);
    NamedArrays before, learned;
    game.team.save("", before);
    game.team.save_batch(rollout, at::arange(r.reward.size(0) * r.reward.size(1)), before);

    const int64_t states = r.reward.size(0) * r.reward.size(1);
    const at::Tensor weight = r.alive.slice(0, 0, r.reward.size(0)).to(at::kFloat).flatten();
    ASSERT_LT(weight.sum().item<double>(), static_cast<double>(weight.numel())) << "nobody is dead";
    const at::Tensor images = rollout.images.draw(0, rollout.images.states.slice(0, 0, r.reward.size(0)).flatten(0, 1));
    const at::Tensor view = view_of(run, r).flatten(0, 1);
    Actor& actor = game.team.actor();
    at::Tensor features;
    const at::Tensor head = actor.forward_sequence(images.flatten(0, 1), {}, &features);
    const at::Tensor layer = saved_as(before, "view/view/weight", {view.size(1), 24}).set_requires_grad(true);
    const at::Tensor bias = saved_as(before, "view/view/bias", {view.size(1)}).set_requires_grad(true);
    const at::Tensor error = (at::addmm(bias, features, layer.t()) - view).square().mean(1);
    const at::Tensor loss_of_view = (error * weight).sum() / weight.sum();
    const at::Tensor log_p = at::log_softmax(head.slice(1, 0, kNDiscreteActions), 1);
    const at::Tensor ratio =
        (log_p.gather(1, r.action.view({states * 2, 1}).to(at::kLong)).squeeze(1) - r.log_prob.flatten()).exp();
    const at::Tensor advantage = saved_as(before, "batch/advantage", {states, 2}).flatten();
    (k.coef * loss_of_view + (-ratio * advantage * weight).sum() / weight.sum()).backward();
    const at::Tensor expected = actor.parameters().gradient().clone();
    actor.parameters().gradient().zero_();

    // The first step of Adam leaves (1 - beta 1) x gradient in its moment, whatever the step size.
    game.team.begin_epoch(rollout, at::arange(game.team.n_sequences()));
    game.team.update_minibatch(rollout, 0, 1);
    game.team.save("", learned);
    const auto gradient = [&](const char* name, int64_t size) { return saved_as(learned, name, {size}) / 0.1; };
    EXPECT_LT(distance(gradient("actor_adam/moment1", expected.numel()), expected), 1e-4);
    const at::Tensor of_layer = at::cat({layer.grad().flatten(), bias.grad()});
    EXPECT_LT(distance(gradient("view_adam/moment1", of_layer.numel()), of_layer), 1e-4);
    const double rows = weight.sum().item<double>();
    EXPECT_NEAR(game.team.figures()[kFigViewLoss].item<double>() / rows, loss_of_view.item<double>(), 1e-5);
  }
}

// Who tells the same of every agent errs by the variance of the view over a rollout.
TEST(LearnViewTeacher, FeaturesComeToTellTheView) {
  SmallRun small = taught_run("");
  small.mappo = "view_coef: 5, learning_rate: 2.0e-3, schedule: constant";
  small.actor = "encoder: compact, hidden: [64], activation: relu";
  small.scenario = "observation: {type: rgb_vector, resolution: 44, egocentric_view: true}\n";
  const LoadedRun run = small.load();
  const auto learner = small.learner();
  LearningTeam game(run);
  game.collector.collect();
  const at::Tensor alive = game.collector.rollout().team[0].alive.slice(0, 0, 8).flatten().to(at::kBool);
  const at::Tensor view = view_of(run, game.collector.rollout().team[0]).flatten(0, 1);
  const double variance = view.index({alive}).var(0).mean().item<double>();
  const double first = metric(learner->update(), "view_loss_0");
  Metrics last;
  for (int u = 0; u < 45; ++u) last = learner->update();
  testing::Test::RecordProperty("variance", std::to_string(variance));
  testing::Test::RecordProperty("first", std::to_string(first));
  testing::Test::RecordProperty("last", std::to_string(metric(last, "view_loss_0")));
  EXPECT_GT(first, 0.9 * variance);
  EXPECT_LT(metric(last, "view_loss_0"), 0.88 * variance);
  EXPECT_LT(metric(last, "view_loss_1"), 0.88 * variance);
}

// A run without it has no columns and no arrays of it.
TEST(LearnViewTeacher, IsAbsentWhereItWeighsNothing) {
  const auto learner = taught_run("0").learner();
  for (const auto& [name, value] : learner->update()) EXPECT_FALSE(name.starts_with("view_")) << name;
  for (const NamedArray& array : saved(*learner)) EXPECT_EQ(array.name.find("view/"), std::string::npos) << array.name;
}

}  // namespace
}  // namespace giga::test
