#include "learn/memory/update.hpp"

#include <algorithm>

#include "learn/mappo/ppo_team.hpp"
#include "learn/memory/network.hpp"
#include "learn/opponents/world_shares.hpp"
#include "learn/team_policy.hpp"
#include "math/ppo_loss.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"

namespace giga {
namespace {

/// LibTorch shuffles on a GPU by sorting: keys and values, sorted and unsorted, and the sort's own memory.
constexpr int64_t kShuffleCopies = 5;

/// The memory of one team's work, step by step.
class TeamWork {
 public:
  TeamWork(const LoadedRun& run, int team, Device device)
      : config_(run.config.mappo),
        shape_(critic_shape(config_.critic, run.spec, team)),
        inputs_(input_columns(config_.actor.inputs, run.spec)),
        discrete_(run.spec.params.actions == ActionKind::discrete),
        head_(Actor::head_size(run.spec.params.actions)),
        n_(run.spec.params.n_team[team]),
        n_worlds_(run.config.train.n_worlds),
        shares_(world_shares(run.config.opponents, n_worlds_)),
        learning_(shares_.learning(team).count),
        global_size_(run.spec.global_size()),
        element_(device.is_cuda() && run.config.train.precision == Precision::bf16 ? 2 : 4) {}

  MemoryByUse play() const;
  MemoryByUse act(int64_t worlds) const;
  MemoryByUse values() const;
  MemoryByUse learn(bool cuda) const;
  MemoryByUse normalise() const;

 private:
  bool everywhere() const { return learning_ == n_worlds_; }
  int64_t states() const { return learning_ * config_.horizon; }  // that are learned from
  int64_t obs_bytes(int64_t rows) const { return kFloat * rows * shape_.inputs.row; }
  MlpMemory actor(MemoryLedger& m, MemoryUse use, int64_t rows) const {
    return {m, use, config_.actor, {inputs_.size, head_, rows, 0, element_}};
  }
  int64_t actor_input(MemoryLedger& m, MemoryUse use, int64_t rows) const;
  MemoryByUse act_in_groups() const;
  void values_of(MemoryLedger& m, int64_t states, int64_t all) const;
  void learn_actor(MemoryLedger& m, int64_t rows) const;
  int64_t information_floats() const;

  const MappoConfig config_;
  const CriticShape shape_;
  const InputColumns inputs_;  // of the actor
  const bool discrete_;
  const int64_t head_, n_, n_worlds_;
  const WorldShares shares_;
  const int64_t learning_;  // worlds
  const int64_t global_size_, element_;
};

// What the actor makes of the observations before its first layer; (x - mean) / std with limits takes three steps.
int64_t TeamWork::actor_input(MemoryLedger& m, MemoryUse use, int64_t rows) const {
  int64_t held = 0;
  if (config_.obs_norm) {
    m.touch(3 * obs_bytes(rows));
    held = obs_bytes(rows);
    m.take(use, held);
  }
  if (element_ == kFloat) return held;
  m.take(use, obs_bytes(rows) / 2);
  m.give(use, held);
  return obs_bytes(rows) / 2;
}

MemoryByUse TeamWork::act(int64_t worlds) const {
  MemoryLedger m;
  const int64_t rows = worlds * n_;
  actor_input(m, MemoryUse::temporary, rows);
  actor(m, MemoryUse::temporary, rows).infer();
  m.touch(element_ == kFloat ? 0 : kFloat * rows * head_);
  return m.peak();
}

// GroupPolicy::forward for the worlds in which the team is frozen.
MemoryByUse TeamWork::act_in_groups() const {
  MemoryLedger m;
  const int64_t rows = shares_.pooled() * n_;
  if (rows == 0) return m.peak();
  actor_input(m, MemoryUse::temporary, rows);
  actor(m, MemoryUse::temporary, rows).infer_members(shares_.groups);
  m.touch(element_ == kFloat ? 0 : kFloat * rows * head_);
  return m.peak();
}

// One part of a team's worlds after the other.
MemoryByUse TeamWork::play() const {
  const MemoryByUse learner = act(learning_), groups = act_in_groups();
  return sum(learner) > sum(groups) ? learner : groups;
}

// PpoTeam::values_of of some of all states, in chunks.
void TeamWork::values_of(MemoryLedger& m, int64_t states, int64_t all) const {
  const int64_t chunk = std::min(states, kValueChunk), rows = chunk * n_;
  m.take(MemoryUse::values, kFloat * all * n_);
  const int64_t norm = config_.obs_norm ? obs_bytes(rows) : 0, alive = kFloat * rows;
  // Observations of a part of the worlds are gathered, as is the true state.
  const int64_t obs = everywhere() ? 0 : obs_bytes(rows);
  const int64_t state = config_.critic.kind == CriticKind::state && !everywhere() ? kFloat * chunk * global_size_ : 0;
  m.touch(obs + 3 * norm);
  const int64_t held = std::max(obs, norm) + alive + state;
  m.take(MemoryUse::temporary, held);
  CriticMemory(m, MemoryUse::temporary, config_.critic, shape_, {chunk, element_}).infer();
  m.give(MemoryUse::temporary, held);
}

// PpoTeam::compute_advantages. The advantages, returns and values of the update before are there until the new ones
// take their place.
MemoryByUse TeamWork::values() const {
  MemoryLedger m;
  const int64_t own = kFloat * states() * n_, of_rollout = kFloat * n_worlds_ * config_.horizon * n_;
  values_of(m, states() + learning_, n_worlds_ * (config_.horizon + 1));
  values_of(m, learning_, n_worlds_);
  m.touch(of_rollout);                                              // advantages
  m.give(MemoryUse::values, of_rollout + kFloat * n_worlds_ * n_);  // the old values
  m.take(MemoryUse::values, own);                                   // weights
  m.touch(3 * own);                                                 // moments: difference, square, product
  return m.peak();
}

// Floats per row of policy_information, besides the head.
int64_t TeamWork::information_floats() const {
  // Probabilities, then q + 1e-12, its logarithm and the product.
  if (discrete_) return 4 * kNDiscreteActions;
  // 3 dimensions of 9 bins: z and `below` at the 8 edges between them, a zero and a one, then both concatenations and
  // their difference.
  return 3 * (8 + 8 + 1 + 1 + 9 + 9 + 9);
}

void TeamWork::learn_actor(MemoryLedger& m, int64_t rows) const {
  const int64_t head = kFloat * rows * head_;
  const int64_t input = actor_input(m, MemoryUse::actor, rows);
  MlpMemory network = actor(m, MemoryUse::actor, rows);
  network.forward();
  if (element_ != kFloat) {
    m.take(MemoryUse::actor, head);
    m.give(MemoryUse::actor, network.output_bytes());
  }
  m.touch(4 * kFloat * rows);  // moments of the advantages
  m.take(MemoryUse::temporary, head);
  const int64_t diagnostics = kFloat * rows * kNPolicyDiagnostics;
  m.take(MemoryUse::temporary, diagnostics);
  m.touch(kFloat * rows * information_floats());
  m.give(MemoryUse::temporary, diagnostics);
  const int64_t gradient = head + (element_ == kFloat ? 0 : network.output_bytes());
  m.take(MemoryUse::temporary, gradient - head);
  network.backward(false);
  m.give(MemoryUse::temporary, gradient);
  m.give(MemoryUse::actor, input);
}

// PpoTeam::update_minibatch on one minibatch. The head stays to the end, as do the observations.
MemoryByUse TeamWork::learn(bool cuda) const {
  MemoryLedger m;
  const int64_t index = static_cast<int64_t>(sizeof(int64_t)) * states();
  if (cuda) m.touch(kShuffleCopies * index);
  m.take(MemoryUse::permutation, index);
  if (!everywhere()) {
    m.touch(3 * index);                         // the second team's: a quotient, the result
    m.take(MemoryUse::permutation, 2 * index);  // places among all worlds, by team
  }

  const int64_t batch = (states() + config_.n_minibatches - 1) / config_.n_minibatches, rows = batch * n_;
  m.take(MemoryUse::minibatch, obs_bytes(rows) + kFloat * rows);
  learn_actor(m, rows);
  if (config_.obs_norm) m.touch(3 * obs_bytes(rows));
  CriticMemory(m, MemoryUse::critic, config_.critic, shape_, {batch, element_}).learn();
  return m.peak();
}

// PpoTeam::update_normalizer: the squares of all observations of the rollout.
MemoryByUse TeamWork::normalise() const {
  MemoryLedger m;
  const int64_t copies = everywhere() ? 1 : 2;  // observations side by side
  if (config_.obs_norm) m.touch(copies * obs_bytes(states() * n_) + 2 * kFloat * states() * n_);
  return m.peak();
}

/// Bytes of the widest layer's features for so many states of the larger team.
int64_t widest_features(const LoadedRun& run, int64_t states) {
  const std::vector<int>&actor = run.config.mappo.actor.hidden, &critic = run.config.mappo.critic.hidden;
  const int width = std::max(*std::max_element(actor.begin(), actor.end()),  //
                             *std::max_element(critic.begin(), critic.end()));
  return kFloat * states * std::max(run.spec.params.n_team[0], run.spec.params.n_team[1]) * width;
}

}  // namespace

std::vector<WorkPhase> work_phases(const LoadedRun& run, Device device) {
  const int64_t w = run.config.train.n_worlds, horizon = run.config.mappo.horizon, episodes = run.config.eval.episodes;
  const int64_t valued = std::min(w * (horizon + 1), kValueChunk), batch = w * horizon / run.config.mappo.n_minibatches;
  const bool all_valued_at_once = valued < kValueChunk;
  std::vector<WorkPhase> phases = {
      {"playing", {}, true, widest_features(run, w), false},
      {"values of the rollout", {}, all_valued_at_once, widest_features(run, valued), false},
      {"learning", {}, true, widest_features(run, batch), true},
      {"observation moments", {}, true, 0, false},
      {"evaluation", {}, false, widest_features(run, episodes), false},
  };
  for (int team = 0; team < kNTeams; ++team) {
    if (!learns(run.config.train, team)) continue;
    const TeamWork work(run, team, device);
    const MemoryByUse peaks[] = {work.play(), work.values(), work.learn(device.is_cuda()), work.normalise(),
                                 work.act(episodes)};
    for (size_t k = 0; k < phases.size(); ++k)
      if (sum(peaks[k]) > sum(phases[k].peak)) phases[k].peak = peaks[k];
  }
  return phases;
}

}  // namespace giga
