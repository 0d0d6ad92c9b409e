// A critic on the features of the actor's encoder: the encoder's gradient is that of both losses, and nothing else
// changes.
#include <gtest/gtest.h>
#include <torch/types.h>

#include <vector>

#include "learn/mappo/ppo_team.hpp"
#include "learn/players/value_function.hpp"
#include "learning_team.hpp"

namespace giga::test {
namespace {

/// What both losses say of the networks, each through a forward pass of its own, by LibTorch's operations.
struct Gradients {
  at::Tensor policy, value;  // of the actor's parameters
  at::Tensor critic;         // of the critic's
};

/// The whole rollout is one minibatch, and its policy has not moved: ratios are 1, and nothing is clipped. Neither
/// advantages nor values are normalised. `critic_memory`: before the rollout.
Gradients gradients_by_hand(LearningTeam& game, const at::Tensor& critic_memory) {
  const MappoConfig& c = game.run.config.mappo;
  const Rollout& rollout = game.collector.rollout();
  const TeamRollout& r = rollout.team[0];
  const int64_t t = c.horizon, w = game.sim->n_worlds(), rows = t * w * 2;
  Actor& actor = game.team.actor();
  NamedArrays arrays;
  game.team.save_critic("", arrays);
  game.team.save_batch(rollout, at::arange(t * w), arrays);
  Critic critic(c.critic, critic_shape(c.critic, actor, game.run.spec, 0), Precision::fp32, game.parallel_for, at::kCPU,
                0);
  critic.parameters().load("critic/", arrays);

  const at::Tensor alive = r.alive.slice(0, 0, t).to(at::kFloat).view({t * w, 2}), weight = alive.flatten();
  const at::Tensor seen = actor.reads_image()
                              ? rollout.images.draw(0, rollout.images.states.slice(0, 0, t).flatten(0, 1))
                              : r.obs.slice(0, 0, t).flatten(0, 1);
  const at::Tensor begins =
      at::cat({at::zeros({1, w}, at::kBool), rollout.done.slice(0, 0, t - 1) != 0}).repeat_interleave(2, 1);
  const auto sequence = [&](const at::Tensor& start) {
    return start.defined() ? Sequence{.length = t, .begins = begins, .start = start.flatten(0, 1)} : Sequence{};
  };
  const auto mean = [&](const at::Tensor& loss) { return (loss * weight).sum() / weight.sum(); };
  const auto taken = [](const ParameterSet& parameters) {
    const at::Tensor gradient = parameters.gradient().clone();
    parameters.gradient().zero_();
    return gradient;
  };

  Gradients g;
  const at::Tensor head = actor.forward_sequence(seen.flatten(0, 1), sequence(r.state));
  const at::Tensor log_p = at::log_softmax(head.slice(1, 0, kNDiscreteActions), 1);
  const at::Tensor ratio =
      (log_p.gather(1, r.action.view({rows, 1}).to(at::kLong)).squeeze(1) - r.log_prob.flatten()).exp();
  EXPECT_LT((ratio - 1).abs().max().item<double>(), 1e-5);
  const at::Tensor advantage = saved_as(arrays, "batch/advantage", {t * w, 2}).flatten();
  mean(-ratio * advantage + c.entropy_coef * (log_p.exp() * log_p).sum(1)).backward();
  g.policy = taken(actor.parameters());

  const at::Tensor features = actor.features(seen.flatten(0, 1)).view({t * w, 2, -1});
  const at::Tensor value = critic.forward(features, alive, {}, sequence(critic_memory)).flatten();
  const at::Tensor returns = saved_as(arrays, "batch/returns", {t * w, 2}).flatten();
  mean(c.value_coef * 0.5 * (value - returns).square()).backward();
  g.value = taken(actor.parameters());
  g.critic = taken(critic.parameters());
  return g;
}

TEST(LearnSharedEncoder, ItsGradientIsThatOfBothLosses) {
  const char* const kImages = "observation: {type: rgb, resolution: 12}\n";
  const char* const kSees = "encoder: impala, impala_width: 2, hidden: [8], activation: relu";
  struct Case {
    const char* name;
    std::string actor, critic, mappo, scenario;
  };
  const Case cases[] = {
      {"composed", "hidden: [16]", "hidden: [12]", "", ""},
      {"no loss of values", "hidden: [16]", "hidden: [12]", ", value_coef: 0", ""},
      {"independent, normalised", "hidden: [16, 8]", "kind: independent, hidden: [12]", ", obs_norm: true", ""},
      {"both remember", "hidden: [16], memory: gru, memory_size: 6", "hidden: [8], memory: lstm, memory_size: 5", "",
       ""},
      {"the actor remembers", "hidden: [16], memory: lstm, memory_size: 6", "hidden: [8]", ", obs_norm: true", ""},
      {"the critic remembers", "hidden: [16]", "kind: independent, hidden: [8], memory: gru, memory_size: 5", "", ""},
      {"images", kSees, "hidden: [12]", "", kImages},
      {"images, both remember", cat(kSees, ", memory: gru, memory_size: 6"),
       "kind: independent, hidden: [8], memory: gru, memory_size: 5", "", kImages},
  };
  for (const Case& k : cases) {
    SCOPED_TRACE(k.name);
    SmallRun small;
    small.actor = cat(k.actor, ", output_gain: 1");
    small.critic = cat(k.critic, ", shared_encoder: true");
    small.mappo = cat("value_norm: false, advantage_norm: none, max_grad_norm: 0", k.mappo);
    small.scenario = k.scenario;
    small.n_threads = 1;
    LoadedRun run = small.load();
    run.config.mappo.n_minibatches = 1;
    LearningTeam game(run);
    for (int before = 0; before < 3; ++before) {
      game.collector.collect();
      game.team.compute_advantages(game.collector.rollout());
      game.team.update_normalizer(game.collector.rollout());
    }
    game.collector.collect();
    const Rollout& rollout = game.collector.rollout();
    ASSERT_GT((rollout.done.slice(0, 0, 7) != 0).sum().item<int>(), 0) << "no episode ends within the rollout";
    NamedArrays memory, learned;
    game.team.save_memory("", memory);
    game.team.compute_advantages(rollout);
    const at::Tensor remembered =
        memory.empty() ? at::Tensor() : saved_as(memory, "critic_memory", memory.front().shape);
    const Gradients expected = gradients_by_hand(game, remembered);
    EXPECT_GT(expected.policy.norm().item<double>(), 1e-3);
    if (run.config.mappo.value_coef > 0) {
      EXPECT_GT(distance(expected.policy + expected.value, expected.policy), 0.05) << "the sum is that of one of them";
    } else {
      EXPECT_EQ(expected.value.norm().item<double>(), 0);
    }

    // The first step of Adam leaves (1 - beta 1) x gradient in its moment, whatever the step size.
    game.team.begin_epoch(rollout, at::arange(game.team.n_sequences()));
    game.team.update_minibatch(rollout, 0, 1);
    game.team.save("", learned);
    const auto gradient = [&](const char* name, int64_t size) { return saved_as(learned, name, {size}) / 0.1; };
    EXPECT_LT(distance(gradient("actor_adam/moment1", expected.policy.numel()), expected.policy + expected.value),
              1e-4);
    const at::Tensor of_critic = gradient("critic_adam/moment1", expected.critic.numel());
    EXPECT_LT((of_critic - expected.critic).norm().item<double>(), 1e-4 * expected.critic.norm().item<double>() + 1e-9);
  }
}

// A critic with an encoder of its own, that starts as the actor's: it gives the same values. Where the loss of values
// weighs nothing, actors learn alike with both critics, to the last bit; where it weighs something they do not.
TEST(LearnSharedEncoder, WithoutItsLossTheActorLearnsAsAlone) {
  for (const char* weight : {"0", "0.5"}) {
    SmallRun small;
    small.train = "opponent: circle";
    small.mappo = cat("fused: false, value_coef: ", weight);
    small.actor = "hidden: [16]";
    small.critic = "kind: independent, shared_encoder: true, hidden: [12]";
    const auto sharing = small.learner();
    small.critic = "kind: independent, hidden: [16, 12]";
    const auto alone = small.learner();
    const NamedArrays from = saved(*sharing);
    NamedArrays arrays = saved(*alone);
    int copied = 0;
    for (NamedArray& a : arrays) {
      const std::string critic = "team_0/critic/mlp/";
      if (!a.name.starts_with(critic)) continue;
      const char layer = a.name[critic.size()];
      const std::string part = a.name.substr(critic.size() + 1);
      const std::string source =
          layer == '0' ? cat("team_0/actor/mlp/0", part) : cat(critic, static_cast<char>(layer - 1), part);
      ASSERT_EQ(find_array(from, source).shape, a.shape) << a.name;
      a.bytes = find_array(from, source).bytes;
      ++copied;
    }
    ASSERT_EQ(copied, 6);
    alone->load(arrays);
    const Metrics a = sharing->update(), b = alone->update();
    EXPECT_EQ(metric(a, "explained_variance_0"), metric(b, "explained_variance_0")) << "the values differ";
    const NamedArrays after = saved(*sharing), after_alone = saved(*alone);
    int compared = 0;
    for (const NamedArray& array : after) {
      if (!array.name.starts_with("team_0/actor")) continue;
      ++compared;
      const bool equal = array.bytes == find_array(after_alone, array.name).bytes;
      if (std::string(weight) == "0") {
        EXPECT_TRUE(equal) << array.name;
      } else if (array.name == "team_0/actor/mlp/0/weight") {
        EXPECT_FALSE(equal);
      }
    }
    EXPECT_EQ(compared, 7);  // two layers, and Adam's two moments and its count
  }
}

// Who looks at games sees the values that were learned from.
TEST(LearnSharedEncoder, ValuesForThoseWhoLookAreThoseOfTheRollout) {
  SmallRun small;
  small.actor = "hidden: [16], memory: gru, memory_size: 6";
  small.critic = "shared_encoder: true, hidden: [12]";
  small.mappo = "obs_norm: true";
  LearningTeam game(small.load());
  for (int k = 0; k < 2; ++k) {
    game.collector.collect();
    game.team.compute_advantages(game.collector.rollout());
    game.team.update_normalizer(game.collector.rollout());
  }
  NamedArrays arrays, batch;
  game.team.save_critic("team_0/", arrays);
  const auto values = ValueFunction::load(game.run, 0, arrays, game.team.actor(), {});
  game.collector.collect();
  const Rollout& rollout = game.collector.rollout();
  const TeamRollout& r = rollout.team[0];
  NetworkState none;
  const at::Tensor seen = values->forward(r.obs[3], r.alive[3], {}, none);  // in units of the rewards so far
  const at::Tensor mean = saved_as(arrays, "team_0/value_norm/mean", {1}),
                   std = saved_as(arrays, "team_0/value_norm/std", {1});
  game.team.compute_advantages(rollout);
  game.team.save_batch(rollout, at::arange(3 * 24, 4 * 24), batch);
  EXPECT_LT((saved_as(batch, "batch/value", {24, 2}) * std + mean - seen).abs().max().item<double>(), 1e-5);
  EXPECT_GT(seen.std().item<double>(), 1e-3);
}

}  // namespace
}  // namespace giga::test
