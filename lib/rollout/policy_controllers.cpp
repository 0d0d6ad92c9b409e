#include "rollout/policy_controllers.hpp"

#include <torch/types.h>

#include <algorithm>
#include <array>

#include "core/error.hpp"
#include "cuda/population_policy.hpp"
#include "math/distributions.hpp"
#include "math/earlier_opponent.hpp"
#include "math/population_actions.hpp"
#include "policy/actor.hpp"
#include "policy/fused_actor.hpp"
#include "rollout/group_policy.hpp"
#include "rollout/population_controller.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

/// With what the fused kernel reads and writes in a step.
FusedPolicy in_step(FusedPolicy policy, const InputColumns& inputs, const TeamStep& s, bool greedy) {
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
  return policy;
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

/// What the agents of a step remember.
at::Tensor memory_of(const TeamStep& s) {
  return wrap(s.buffers.memory, {s.n_rows(), s.buffers.memory_size}, s.sim.device());
}

/// The output of a policy for the rows of a step, and what they remember after it.
struct PolicyOutput {
  at::Tensor head;
  NetworkState state;

  template <class AnyPolicy>
  PolicyOutput(const AnyPolicy& policy, const TeamStep& s) {
    if (policy.state_size() > 0) state.rows = memory_of(s);
    head = policy.forward(obs_of(policy, s), state);
  }
  /// It is what they remember from here on.
  void keep(const TeamStep& s) const {
    if (state.rows.defined()) memory_of(s).copy_(state.rows);
  }
};

class PolicyController final : public TeamController {
 public:
  PolicyController(const Policy& policy0, const Policy& policy1, bool greedy)
      : of_team_{Of(policy0), Of(policy1)}, greedy_(greedy) {
    GIGA_CHECK(policy0.state_size() == policy1.state_size(), "policies that remember ", policy0.state_size(), " and ",
               policy1.state_size(), " numbers in one controller");
  }

  ObservationSet reads() const override { return of_team_[0].policy.reads() | of_team_[1].policy.reads(); }
  bool fills_log_prob() const override { return true; }
  int64_t memory_size() const override { return of_team_[0].policy.state_size(); }
  bool repeats() const override {
    return of_all([](const Actor& actor) { return fused_policy(actor) || HalfPrecisionPolicy::served(actor); });
  }
  bool repeats_where_kept() const override {  // LibTorch plays fp16 there
    return of_all([](const Actor& actor) { return fused_policy(actor).has_value(); });
  }
  void act(std::span<const TeamStep> parts) override {
    at::NoGradGuard no_grad;
    // A GPU takes hardly longer for more rows. A CPU does, and its products may round by where a row stands; images
    // take much memory.
    const bool joins = parts[0].sim.device().is_cuda() && !reads().has(Observation::image);
    const std::vector<TeamStep> wide = joins ? joined(parts) : std::vector<TeamStep>();
    std::vector<FusedPolicy> together;  // one launch where they have few rows
    size_t number = 0;
    for (const TeamStep& part : joins ? std::span(wide) : parts) {
      const Of& own = of_team_[static_cast<size_t>(part.team)];
      const std::optional<FusedPolicy> fused = own.actor ? fused_policy(*own.actor) : std::nullopt;
      const std::optional<SmallMlp> half = own.actor && !fused ? HalfPrecisionPolicy::served(*own.actor) : std::nullopt;
      // Which that kernel does not fill in. A collector keeps them, of the pool's opponents too: there LibTorch plays a
      // network of fp16, else the kernel, and their logits differ by the order of sums and by tanh, which is within
      // 2^-11.
      const bool learns = part.buffers.log_prob || part.buffers.pre_tanh_action;
      if (fused)
        together.push_back(in_step(*fused, own.actor->inputs(), part, greedy_));
      else if (half && !learns)
        half_.act(*own.actor, *half, part, number, greedy_);
      else
        act(own.policy, part);
      ++number;
    }
    act_fused(together, parts[0].behind_step, parts[0].parallel_for);
  }

 private:
  struct Of {
    explicit Of(const Policy& p) : policy(p), actor(dynamic_cast<const Actor*>(&p)) {}
    const Policy& policy;
    const Actor* const actor;  ///< the policy, if it is one that kernels may know
  };

  template <class F>
  bool of_all(F&& f) const {
    return std::all_of(of_team_.begin(), of_team_.end(), [&](const Of& of) { return of.actor && f(*of.actor); });
  }

  void act(const Policy& policy, const TeamStep& s) const {
    const TeamBuffers& b = s.buffers;
    const PolicyOutput out(policy, s);
    out.keep(s);
    const at::Tensor& head = out.head;
    if (s.sim.params().actions == ActionKind::discrete) {
      s.parallel_for.run(SampleCategorical{head.const_data_ptr<float>(), s.draws(), static_cast<int32_t*>(b.action),
                                           b.log_prob, greedy_},
                         s.n_rows());
    } else {
      const at::Tensor log_std = policy.log_std();
      s.parallel_for.run(SampleGaussian{head.const_data_ptr<float>(), log_std.const_data_ptr<float>(), s.draws(),
                                        b.pre_tanh_action, static_cast<float*>(b.action), b.log_prob, greedy_},
                         s.n_rows());
    }
  }

  const std::array<Of, kNTeams> of_team_;
  HalfPrecisionPolicy half_;
  const bool greedy_;
};

/// Where anybody plays the earlier generation, both act in all worlds, with the same draws; the earlier one in a room
/// of its own, from which its actions are taken where it plays.
class GroupController final : public TeamController {
 public:
  explicit GroupController(const TwoGenerations& policies) : now_(policies.now), policies_(policies) {}

  ObservationSet reads() const override { return now_.reads(); }
  int64_t memory_size() const override { return now_.state_size(); }
  bool repeats() const override { return now_.fused().has_value(); }
  void act(std::span<const TeamStep> parts) override {
    const std::optional<FusedPolicy> fused = now_.fused();
    // What a GPU has recorded serves all rollouts: its kernels find out for themselves whether an earlier one plays.
    const bool both = policies_.any_plays || (fused && parts[0].parallel_for.device().is_cuda());
    const std::vector<TeamStep> earlier = both ? earlier_steps(parts) : std::vector<TeamStep>();
    const std::optional<FusedPolicy> fused_earlier = fused && both ? policies_.earlier.fused() : std::nullopt;
    std::vector<FusedPolicy> together;
    for (size_t k = 0; k < parts.size(); ++k) {
      // Where the earlier generation plays, actions are of another network.
      const TeamStep part = parts[k].without_log_prob();
      GIGA_CHECK(part.worlds.count % now_.groups() == 0, part.worlds.count, " worlds for ", now_.groups(), " groups");
      if (!fused) {
        act(part, both ? &earlier[k] : nullptr);
        continue;
      }
      together.push_back(in_step(*fused, now_.inputs(), part, false));
      if (!both) continue;
      together.push_back(in_step(*fused_earlier, now_.inputs(), earlier[k], false));
      together.back().plays = policies_.plays.const_data_ptr<uint8_t>();
    }
    act_fused(together, parts[0].behind_step, parts[0].parallel_for);
    for (size_t k = 0; fused && k < earlier.size(); ++k) take_action(parts[k], earlier[k]);
  }

 private:
  /// The same steps with actions in the controller's own room.
  std::vector<TeamStep> earlier_steps(std::span<const TeamStep> parts) {
    const int64_t per_row = is_discrete() ? 1 : kActionSize;
    int64_t size = 0;
    for (const TeamStep& part : parts) size += part.n_rows() * per_row;
    if (!action_.defined() || action_.size(0) < size)
      action_ = at::empty({size}, now_.rows().options().dtype(is_discrete() ? at::kInt : at::kFloat));
    std::vector<TeamStep> steps;
    auto* next = static_cast<char*>(action_.data_ptr());
    for (const TeamStep& part : parts) {
      TeamStep& step = steps.emplace_back(part.without_log_prob());
      step.buffers.action = next;
      next += step.n_rows() * per_row * static_cast<int64_t>(action_.element_size());
    }
    return steps;
  }

  /// By LibTorch; `earlier`: null where nobody plays the earlier generation.
  void act(const TeamStep& s, const TeamStep* earlier) const {
    const PolicyOutput out(now_, s);
    sample(now_, out.head, s);
    if (!earlier) return out.keep(s);
    const PolicyOutput other(policies_.earlier, s);
    sample(policies_.earlier, other.head, *earlier);
    take_action(s, *earlier);
    out.keep(s);
    if (other.state.rows.defined())
      take(s, other.state.rows.const_data_ptr<float>(), s.buffers.memory, s.n() * s.buffers.memory_size);
  }

  void sample(const GroupPolicy& policy, const at::Tensor& head, const TeamStep& s) const {
    s.parallel_for.run(PopulationActions{{policy.actions(), false, s.draws(), s.buffers.action},
                                         head.const_data_ptr<float>(),
                                         static_cast<int>(policy.head_size()),
                                         policy.rows().const_data_ptr<float>(),
                                         policy.rows().size(1),
                                         is_discrete() ? 0 : policy.log_std_offset(),
                                         nullptr,
                                         s.worlds.count / policy.groups()},
                       s.n_rows());
  }

  void take_action(const TeamStep& s, const TeamStep& earlier) const {
    if (is_discrete())
      take(s, static_cast<const int32_t*>(earlier.buffers.action), static_cast<int32_t*>(s.buffers.action), s.n());
    else
      take(s, static_cast<const float*>(earlier.buffers.action), static_cast<float*>(s.buffers.action),
           s.n() * kActionSize);
  }

  /// Numbers of the worlds of a step in which the earlier generation plays.
  template <class T>
  void take(const TeamStep& s, const T* from, T* to, int64_t per_world) const {
    const StateView state = s.sim.state().view();
    const auto* drawn_at = reinterpret_cast<const uint32_t*>(policies_.drawn_at.const_data_ptr<int32_t>());
    const int64_t first = s.worlds.first;
    s.parallel_for.run(
        TakeEarlier<T>{{state.episode_length + first, state.draw_step + first, drawn_at + first}, from, to, per_world},
        s.worlds.count * per_world);
  }

  bool is_discrete() const { return now_.actions() == ActionKind::discrete; }

  const GroupPolicy& now_;
  const TwoGenerations& policies_;
  at::Tensor action_;  // of all parts, one behind the other; stays where it is
};

}  // namespace

std::unique_ptr<TeamController> policy_controller(const Policy& policy, bool greedy) {
  return std::make_unique<PolicyController>(policy, policy, greedy);
}

std::unique_ptr<TeamController> policy_controller(const Actor& actor, bool greedy) {
  return policy_controller(static_cast<const Policy&>(actor), greedy);
}

std::unique_ptr<TeamController> policies_controller(const Actor& actor0, const Actor& actor1) {
  return std::make_unique<PolicyController>(actor0, actor1, false);
}

std::unique_ptr<TeamController> group_controller(const TwoGenerations& policies) {
  return std::make_unique<GroupController>(policies);
}

}  // namespace giga
