// PpoTeam: the networks of one team, and how they learn from a rollout: advantages.cpp has what they learn from,
// ppo_team.cpp how, diagnostics.cpp what is reported.
#pragma once

#include <torch/types.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/parallel_for.hpp"
#include "learn/learner.hpp"
#include "learn/mappo/fused_update.hpp"
#include "learn/mappo/recorded_minibatches.hpp"
#include "learn/mappo/view_teacher.hpp"
#include "math/ppo_figures.hpp"
#include "policy/actor.hpp"
#include "policy/critic.hpp"
#include "policy/optimizer.hpp"
#include "rollout/collector.hpp"

namespace giga {

/// Rows, of an agent in a state, per call of the critic outside of learning: bounds the memory.
constexpr int64_t kValueRows = 1 << 20;

/// What may change from update to update.
struct StepSettings {
  float actor_step_size = 0, critic_step_size = 0;
  float gamma, clip_coef;
  float entropy_coef;  ///< weight of the entropy bonus

  /// Those of the config; the step sizes are 0.
  static StepSettings of(const MappoConfig& c) {
    return {.gamma = c.gamma, .clip_coef = c.clip_coef, .entropy_coef = c.entropy_coef};
  }
};

/// A state is one world at one step, with the n agents of the team; the T x W states of a rollout are numbered step by
/// step.
class PpoTeam {
 public:
  /// Learns only from `worlds` of a rollout. `sum`: over all ranks, each of which has a PpoTeam with as many worlds and
  /// takes the same steps. `twin`: a team with whom it has one actor and one optimizer of it, which each of them steps
  /// (mappo.one_policy); it must outlive this, is loaded before it, and has its minibatches in turns with this one, of
  /// the same epochs. What stops one of them stops both: a fault, or mappo.target_kl.
  PpoTeam(const LoadedRun& run, int team, Device device, const ParallelFor& parallel_for, const ShardRange& worlds,
          const SumOverRanks& sum = {}, PpoTeam* twin = nullptr);

  Actor& actor() { return actor_; }
  bool needs_state() const { return critic_.needs_state(); }
  bool critic_reads_image() const { return critic_.reads_image(); }
  /// What its networks read of the observations.
  ObservationSet reads() const {
    const ObservationSet networks = actor_.reads() | critic_.reads();
    return teacher_ ? networks | teacher_->reads() : networks;
  }
  /// Why LibTorch computes the update, and not the fused kernels; empty where these do.
  const std::string& plain_because() const { return plain_because_; }
  /// Whether they compute the actor's part of it then.
  bool actor_is_fused() const { return fused_actor_ != nullptr; }

  /// For advantages and steps from here on. Before the first call: StepSettings::of().
  void set(const StepSettings& settings);
  /// Has LibTorch's work for minibatches recorded once it has run for a whole update; not for one of several ranks. For
  /// a team that learns by the fused kernels nothing changes.
  void record_minibatches(std::shared_ptr<TorchRecorder> recorder);
  /// Values, advantages and returns of a rollout; clears the figures. A critic with memory goes on from the rollout
  /// before, and remembers what it knows before the next one.
  void compute_advantages(const Rollout& rollout);

  /// Steps that are learned from in a row: 1 for networks without memory, else the rollout.
  int64_t sequence_length() const { return actor_.state_size() > 0 || critic_.state_size() > 0 ? config_.horizon : 1; }
  int64_t n_sequences() const { return config_.horizon * n_own_worlds() / sequence_length(); }
  int64_t n_own_worlds() const { return worlds_.count(); }  ///< that it learns from
  /// The minibatches of an epoch: an order of the sequences cut into pieces, as equal as possible. Sequence k begins at
  /// state k of the team's own worlds, numbered step by step. -> states [L, B] of the rollout each.
  std::vector<at::Tensor> minibatches(const at::Tensor& order) const;
  /// A pass over the rollout in the minibatches of this order of the sequences.
  void begin_epoch(const Rollout& rollout, const at::Tensor& order);
  /// After its last minibatch.
  void end_epoch();
  /// One gradient step of actor and critic on minibatch k of the epoch. `minibatch`: its number in the update, from 1.
  void update_minibatch(const Rollout& rollout, int k, int minibatch);

  /// Takes the rollout's observations into the normaliser.
  void update_normalizer(const Rollout& rollout);

  at::Tensor figures() const { return at::cat({figures_, faults_}); }  // [kNFigures]
  /// The states of the rollout for states of the team's own worlds; int64 of any shape.
  at::Tensor states(const at::Tensor& own) const;
  /// Of several ranks, once a fault is known: whether it is in this one's own numbers, before any are added up.
  bool is_own(PpoFault fault_of_rollout) const;
  /// The same of a gradient, which all ranks compute once more for that: of minibatch k of the epoch with this order,
  /// by its number `minibatch` in the update. No step is taken.
  bool is_own(PpoFault fault_of_gradient, const Rollout& rollout, const at::Tensor& order, int k, int minibatch);
  /// States [B] of the rollout with a number that is not finite, at most `most`.
  at::Tensor faulty_states(const Rollout& rollout, int64_t most) const;
  /// Everything that is learned from in these states.
  void save_batch(const Rollout& rollout, const at::Tensor& states, NamedArrays& out) const;

  /// What the critic remembers of the games that go on; nothing without memory.
  void save_memory(const std::string& prefix, NamedArrays& out) const;
  void load_memory(const std::string& prefix, const NamedArrays& in);
  void forget();

  void save_critic(const std::string& prefix, NamedArrays& out) const;
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  /// Inputs of the critic: obs [S, n, D], alive [S, n]; the true state [S, G] if it needs that, and what images are
  /// drawn from [S, words] if it reads them. What is undefined is not read.
  struct CriticInput {
    at::Tensor obs, alive, state, image_state;

    template <class F>
    CriticInput each(F&& f) const {
      const auto of = [&](const at::Tensor& x) { return x.defined() ? f(x) : x; };
      return {of(obs), of(alive), of(state), of(image_state)};
    }
  };
  /// What actor and critic learn from in a step: S = L B states.
  struct Minibatch {
    const float* number;   // [1] in the update, from 1
    int64_t length;        // L
    at::Tensor states;     // [S] of the rollout, step by step
    at::Tensor begins;     // [L, B] bool: the first steps of episodes; undefined where nobody remembers
    at::Tensor obs;        // [S, n, D]; undefined where nobody reads numbers
    at::Tensor images;     // [S, n, R R 3] bytes; undefined where nobody reads them
    at::Tensor alive;      // [S, n] fp32
    at::Tensor inv_count;  // [1] 1 / living rows, of all ranks; undefined until it is learned from
  };
  ValueError value_error() const;
  FusedPolicyLoss fused_policy_loss(const TeamRollout& rollout) const;
  void update_actor_fused(const Rollout& rollout, const Minibatch& batch);
  void update_fused(const Rollout& rollout, int k, const float* number);
  /// `with_obs`: the kernel of an actor reads them where they lie.
  Minibatch minibatch_of(const Rollout& rollout, const at::Tensor& states, const float* number,
                         bool with_obs = true) const;
  void learn_from(const Rollout& rollout, Minibatch batch);
  at::Tensor inverse_count(const at::Tensor& weight) const;
  void step_actor(const float* minibatch);
  void step_critic(const float* minibatch);
  /// Backpropagates the gradients of the losses by these outputs; with a teacher, also of what it is told by the
  /// actor's features, and steps it. The actor steps afterwards.
  void learn(const Minibatch& batch, const at::Tensor& features, std::vector<at::Tensor> outputs,
             std::vector<at::Tensor> gradients);
  CriticInput critic_input(const Rollout& rollout, bool final) const;
  at::Tensor critic_values(const KeptImages& images, const CriticInput& input, const Sequence& sequence = {}) const;
  at::Tensor values_of(const KeptImages& images, const CriticInput& input, const at::Tensor& states) const;
  std::pair<at::Tensor, at::Tensor> remembering_values(const Rollout& rollout);
  Sequence sequence_of(const Minibatch& batch, const at::Tensor& start) const;
  Sequence actor_sequence(const TeamRollout& rollout, const Minibatch& batch) const;
  at::Tensor head_of(const Rollout& rollout, const Minibatch& batch, at::Tensor* features = nullptr) const;
  void update_actor(const Rollout& rollout, const Minibatch& batch);
  at::Tensor policy_loss_gradient(const TeamRollout& rollout, const Minibatch& batch, const at::Tensor& head);
  void update_critic(const Rollout& rollout, const Minibatch& batch);
  at::Tensor value_loss_gradient(const TeamRollout& rollout, const Minibatch& batch, const at::Tensor& value);
  void update_sharing(const Rollout& rollout, const Minibatch& batch);
  void sum_gradient(PpoFault fault, const ParameterSet& parameters);
  StepFlags step_flags(PpoFault fault, PpoFigure norm_sum, const float* minibatch) const;
  void take_moments(const TeamRollout& rollout);
  at::Tensor find_faults(const TeamRollout& rollout);
  PolicyNote policy_note(const float* sums, const float* minibatch) const;
  void note_information(const Rollout& rollout);
  /// Of a twin, whose actor is loaded: throws InputError where `in` has another one for this team.
  void expect_twins_actor(const std::string& prefix, const NamedArrays& in) const;
  bool everywhere() const { return worlds_.everywhere(); }
  /// The part of x [T, W, ...] in the team's worlds.
  at::Tensor own(const at::Tensor& x) const;

  const MappoConfig config_;
  const int team_, n_;
  const int64_t n_worlds_;
  const ShardRange worlds_;
  const ParallelFor& parallel_for_;
  const SumOverRanks sum_;
  std::unique_ptr<Actor> own_actor_;  // null: the twin's
  Actor& actor_;
  Critic critic_;
  std::unique_ptr<Adam> own_actor_adam_;  // null likewise
  Adam& actor_adam_;
  Adam critic_adam_;
  std::string plain_because_;
  std::unique_ptr<FusedUpdate> fused_;               // null: LibTorch
  std::unique_ptr<FusedActorGradient> fused_actor_;  // beside a critic by LibTorch; null: the actor likewise
  std::unique_ptr<ViewTeacher> teacher_;             // null: mappo.view_coef is 0
  std::unique_ptr<RecordedMinibatches> recorded_;    // null: LibTorch's work is queued kernel by kernel
  RunningNorm value_norm_;                           // size 1; stays 0 and 1 where it is off
  // What the fused kernels and recorded minibatches read of the device's memory.
  enum Setting : int { kActorStepSize, kCriticStepSize, kClip, kEntropyWeight, kNSettings };
  const float* setting(Setting k) const { return settings_.const_data_ptr<float>() + k; }
  float gamma_ = 0;
  at::Tensor settings_;  // [kNSettings]
  at::Tensor numbers_;   // [n_epochs n_minibatches] 1, 2, ...: of the minibatches of an update

  std::vector<at::Tensor> minibatches_;  // of the epoch: states [L, B] each
  bool first_epoch_ = true;              // of the update is yet to come
  int64_t n_rollouts_ = 0;               // that were learned from, with the one at hand

  // What the critic remembers: of each agent, before the latest rollout and after it; undefined without memory.
  at::Tensor critic_start_, critic_memory_;  // [W, n, S]
  at::Tensor slots_;  // [(T + 1) x own worlds] all states of the team's worlds; undefined where those are all worlds

  // Of the latest rollout; T x W states, n agents. Without meaning in worlds in which the team does not learn. Each
  // keeps its place, where recorded minibatches read it.
  at::Tensor value_;                       // [T, W, n] the critic's output before the update, normalised
  at::Tensor advantage_, returns_;         // [T, W, n] in reward units
  at::Tensor batch_mean_, batch_inv_std_;  // [] of the advantages
  at::Tensor living_;                      // [] agents of its worlds that live, over all steps and ranks
  at::Tensor zero_, one_;                  // [1]
  at::Tensor stop_;                        // [1] 1 once approx_kl has passed target_kl; the twin's too
  at::Tensor figures_;                     // [kFirstFault]
  at::Tensor faults_of_both_;              // [kNTeams, kNFaults] of twins; without one the second row is 0
  at::Tensor faults_;                      // [kNFaults] its own row
  at::Tensor own_faults_;                  // [kNFaults] of this rank's rollout; undefined with one rank
  std::optional<PpoFault> looked_at_;      // a gradient whose part of this rank is looked at; none: nobody looks
  at::Tensor own_norm_;                    // [] of that part
};

/// Mean and deviation of the entries with weight, by two sums, each of which is to be added up over the ranks before
/// the next step. `inv_count`: 1 / their number, of all ranks.
struct WeightedMoments {
  WeightedMoments(const at::Tensor& x, const at::Tensor& weight);
  void square(const at::Tensor& inv_count);               // after total
  at::Tensor inv_std(const at::Tensor& inv_count) const;  // after squares

  at::Tensor x, weight;
  at::Tensor total;    // [] sum of x
  at::Tensor mean;     // []
  at::Tensor squares;  // [] sum of the squared distances from the mean
};

/// Mean and 1 / deviation over the entries with weight, of which all ranks have 1 / inv_count.
std::pair<at::Tensor, at::Tensor> weighted_moments(const at::Tensor& x, const at::Tensor& weight,
                                                   const at::Tensor& inv_count, const SumOverRanks& sum = {});

}  // namespace giga
