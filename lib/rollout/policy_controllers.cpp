#include "rollout/policy_controllers.hpp"

#include <torch/types.h>

#include "core/error.hpp"
#include "cuda/population_policy.hpp"
#include "math/distributions.hpp"
#include "math/population_actions.hpp"
#include "policy/actor.hpp"
#include "policy/fused_actor.hpp"
#include "rollout/group_policy.hpp"
#include "rollout/population_controller.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

/// Fills in what the fused kernel reads and writes in a step.
void act_fused(FusedPolicy policy, const InputColumns& inputs, const TeamStep& s, bool greedy) {
  const TeamBuffers& b = s.buffers;
  policy.rows_per_group = s.n_rows() / policy.groups;
  policy.obs = b.obs + inputs.first;
  policy.obs_stride = s.obs_stride();
  if (policy.actions == ActionKind::discrete)
    policy.discrete = {nullptr, s.draws(), static_cast<int32_t*>(b.action), b.log_prob, greedy};
  else
    policy.continuous = {
        nullptr, policy.continuous.log_std, s.draws(), b.pre_tanh_action, static_cast<float*>(b.action), b.log_prob,
        greedy};
  act_fused(policy, s.parallel_for);
}

/// A network of fp16 in all worlds of a step, by the kernel that plays populations of it. It is packed, and the worlds
/// that play are listed, at each step, so that nobody need tell that the network has changed, or that another game is
/// played.
class HalfPrecisionPolicy {
 public:
  /// None where the kernel does not serve the network.
  static std::optional<SmallMlp> served(const Actor& actor) {
    if (!takes_fused_kernel(actor) || !population_policy_runs(actor.parameters().values().get_device()))
      return std::nullopt;
    return actor.small_mlp();
  }

  /// `part`: which of the step's parts this is; each has room of its own.
  void act(const Actor& actor, const SmallMlp& mlp, const TeamStep& s, size_t part, bool greedy) {
    const at::Tensor& values = actor.parameters().values();
    const int device = s.parallel_for.device().index, worlds = static_cast<int>(s.worlds.count);
    void* const stream = s.parallel_for.stream();
    PopulationPolicy policy;
    policy.packed = PackedMlp(mlp);
    policy.obs_stride = s.obs_stride();
    policy.phase = s.sim.state().view().phase + s.worlds.first;
    policy.n_parts = 1;
    NetworkGroups& all = policy.part[0];
    all.groups = all.world_step = 1;
    all.worlds_per_group = worlds;
    all.group_step = worlds;
    all.obs = s.buffers.obs + actor.inputs().first;
    all.act = {s.sim.params().actions, greedy, s.draws(), s.buffers.action};

    if (rooms_.size() <= part) rooms_.resize(part + 1);
    Room& room = rooms_[part];
    const auto grow = [&](at::Tensor& tensor, int64_t size, at::ScalarType type) {
      if (!tensor.defined() || tensor.size(0) < size) tensor = at::empty({size}, values.options().dtype(type));
    };
    grow(room.packed, policy.packed.size, at::kHalf);
    grow(room.work, population_work(policy), at::kInt);
    auto* const packed = static_cast<uint16_t*>(room.packed.data_ptr());
    all.networks = packed;
    policy.work = room.work.data_ptr<int32_t>();
    pack_population(policy.packed, values.const_data_ptr<float>(), 1, values.size(0), packed, device, stream);
    list_population_work(policy, device, stream);
    launch_population_policy(policy, device, stream);
  }

 private:
  struct Room {
    at::Tensor packed;  // [PackedMlp::size] fp16
    at::Tensor work;    // int32: see PopulationPolicy
  };
  std::vector<Room> rooms_;
};

/// What a policy reads of a step: the images of its agents, or their rows of numbers.
template <class AnyPolicy>
at::Tensor obs_of(const AnyPolicy& policy, const TeamStep& step) {
  if (policy.reads().has(Observation::image))
    return wrap(step.buffers.image, {step.n_rows(), image_bytes(step.sim.params().resolution)}, step.sim.device());
  return wrap(step.buffers.obs, {step.n_rows(), step.obs_stride()}, step.sim.device());
}

/// The output of a policy for the rows of a step; what it remembers goes on.
template <class AnyPolicy>
at::Tensor remembering(const AnyPolicy& policy, const TeamStep& s) {
  NetworkState state;
  if (policy.state_size() == 0) return policy.forward(obs_of(policy, s), state);
  const at::Tensor memory = wrap(s.buffers.memory, {s.n_rows(), s.buffers.memory_size}, s.sim.device());
  state.rows = memory;
  const at::Tensor head = policy.forward(obs_of(policy, s), state);
  memory.copy_(state.rows);
  return head;
}

class PolicyController final : public TeamController {
 public:
  PolicyController(const Policy& policy, bool greedy)
      : policy_(policy), actor_(dynamic_cast<const Actor*>(&policy)), greedy_(greedy) {}

  ObservationSet reads() const override { return policy_.reads(); }
  bool fills_log_prob() const override { return true; }
  int64_t memory_size() const override { return policy_.state_size(); }
  bool repeats() const override { return actor_ && (fused_policy(*actor_) || HalfPrecisionPolicy::served(*actor_)); }
  bool repeats_where_kept() const override { return actor_ && fused_policy(*actor_); }  // LibTorch plays fp16 there
  void act(std::span<const TeamStep> parts) override {
    at::NoGradGuard no_grad;
    const std::optional<FusedPolicy> fused = actor_ ? fused_policy(*actor_) : std::nullopt;
    // A GPU takes hardly longer for more rows. A CPU does, and its products may round by where a row stands; images
    // take much memory.
    const bool joins = parts[0].sim.device().is_cuda() && !policy_.reads_image();
    const std::vector<TeamStep> wide = joins ? joined(parts) : std::vector<TeamStep>();
    const std::optional<SmallMlp> half = actor_ && !fused ? HalfPrecisionPolicy::served(*actor_) : std::nullopt;
    size_t number = 0;
    for (const TeamStep& part : joins ? std::span(wide) : parts) {
      // Which that kernel does not fill in. A collector keeps them, of opponents too: there LibTorch plays a network of
      // fp16, in matches the kernel, and their logits differ by the order of sums and by tanh, which is within 2^-11.
      const bool learns = part.buffers.log_prob || part.buffers.pre_tanh_action;
      if (fused)
        act_fused(*fused, actor_->inputs(), part, greedy_);
      else if (half && !learns)
        half_.act(*actor_, *half, part, number, greedy_);
      else
        act(part);
      ++number;
    }
  }

 private:
  void act(const TeamStep& s) const {
    const TeamBuffers& b = s.buffers;
    const at::Tensor head = remembering(policy_, s);
    if (s.sim.params().actions == ActionKind::discrete) {
      s.parallel_for.run(SampleCategorical{head.const_data_ptr<float>(), s.draws(), static_cast<int32_t*>(b.action),
                                           b.log_prob, greedy_},
                         s.n_rows());
    } else {
      const at::Tensor log_std = policy_.log_std();
      s.parallel_for.run(SampleGaussian{head.const_data_ptr<float>(), log_std.const_data_ptr<float>(), s.draws(),
                                        b.pre_tanh_action, static_cast<float*>(b.action), b.log_prob, greedy_},
                         s.n_rows());
    }
  }

  const Policy& policy_;
  const Actor* const actor_;  // the policy, if it is one that kernels may know
  HalfPrecisionPolicy half_;
  const bool greedy_;
};

class GroupController final : public TeamController {
 public:
  explicit GroupController(const GroupPolicy& policy) : policy_(policy) {}

  ObservationSet reads() const override { return policy_.reads(); }
  int64_t memory_size() const override { return policy_.state_size(); }
  bool repeats() const override { return policy_.fused().has_value(); }
  void act(std::span<const TeamStep> parts) override {
    const std::optional<FusedPolicy> fused = policy_.fused();
    for (const TeamStep& part : parts) {
      GIGA_CHECK(part.worlds.count % policy_.groups() == 0, part.worlds.count, " worlds for ", policy_.groups(),
                 " groups");
      fused ? act_fused(*fused, policy_.inputs(), part, false) : act(part);
    }
  }

 private:
  void act(const TeamStep& s) const {
    const at::Tensor head = remembering(policy_, s);
    const bool continuous = policy_.actions() == ActionKind::continuous;
    s.parallel_for.run(PopulationActions{{policy_.actions(), false, s.draws(), s.buffers.action},
                                         head.const_data_ptr<float>(),
                                         static_cast<int>(policy_.head_size()),
                                         policy_.rows().const_data_ptr<float>(),
                                         policy_.rows().size(1),
                                         continuous ? policy_.log_std_offset() : 0,
                                         nullptr,
                                         s.worlds.count / policy_.groups()},
                       s.n_rows());
  }

  const GroupPolicy& policy_;
};

}  // namespace

std::unique_ptr<TeamController> policy_controller(const Policy& policy, bool greedy) {
  return std::make_unique<PolicyController>(policy, greedy);
}

std::unique_ptr<TeamController> policy_controller(const Actor& actor, bool greedy) {
  return policy_controller(static_cast<const Policy&>(actor), greedy);
}

std::unique_ptr<TeamController> group_controller(const GroupPolicy& policy) {
  return std::make_unique<GroupController>(policy);
}

}  // namespace giga
