// The fused policy of a team: observations to actions in one kernel, for the networks that the fused gradients serve
// too.
#pragma once

#include <span>

#include "cuda/ppo_gradients.hpp"
#include "math/distributions.hpp"

namespace giga {

/// One network for all rows, or one for each of several groups of rows in a row, equally many each.
struct FusedPolicy {
  static constexpr int kWideInput = 64;  ///< most numbers that a wide network may read
  static bool serves(const FusedMlp& net) { return net.fits() && (!net.is_wide() || net.width[0] <= kWideInput); }

  FusedMlp net{};
  int groups = 1;
  int64_t rows_per_group = 0;
  const float* parameters = nullptr;  // [groups, group_stride] the network, then what observations are normalised by
  int64_t group_stride = 0;
  const float* obs = nullptr;  // [groups rows, obs_stride], from the first number that the network reads
  int64_t obs_stride = 0;
  const float* obs_mean = nullptr;  // [groups, .. input] group_stride apart; null: observations are not normalised
  const float* obs_std = nullptr;
  float obs_limit = 0;
  ActionKind actions = ActionKind::discrete;
  SampleCategorical discrete{};    // without logits
  SampleGaussian continuous{};     // without means; log_std is that of the first group
  const uint8_t* plays = nullptr;  // [groups] 0: the rows of the group are left as they are; null: all play

  GIGA_HD bool group_plays(int64_t group) const { return !plays || plays[group]; }

  /// What the group reads whose parameters begin at `offset`.
  GIGA_HD FusedRows rows(int64_t offset) const {
    return {.obs = obs,
            .obs_stride = obs_stride,
            .obs_mean = obs_mean ? obs_mean + offset : nullptr,
            .obs_std = obs_mean ? obs_std + offset : nullptr,
            .obs_limit = obs_limit};
  }
  /// How it acts where actions are continuous.
  GIGA_HD SampleGaussian gaussian(int64_t offset) const {
    SampleGaussian of_group = continuous;
    if (actions == ActionKind::continuous) of_group.log_std += offset;
    return of_group;
  }
  /// Draws the action of a row by what the network says of it; `gaussian`: that of its group.
  template <class Row = Logits>
  GIGA_HD void sample(int64_t row, const float* head, const SampleGaussian& gaussian) const {
    if (actions == ActionKind::discrete)
      discrete.sample<Row>(row, head);
    else
      gaussian.sample(row, head);
  }
};

/// Those that one launch serves at most, by value.
struct FusedPolicies {
  static constexpr int kMost = 2;
  FusedPolicy policy[kMost];
};

/// The numbers of inputs and of a hidden layer, padded, that the kernels for a network are made for.
struct PolicyShape {
  static constexpr int kInputs[] = {64, 128, 160, FusedMlp::kMaxInput};
  static constexpr int kCrowdInput = kInputs[2];  ///< narrow networks only: rows with the usual neighbors (rules 7.1)
  int in = FusedMlp::kMaxInput, hidden = FusedMlp::kHidden;

  explicit PolicyShape(const FusedMlp& net) {
    if (!net.is_wide()) hidden = net.is_narrow() ? FusedMlp::kNarrowHidden : FusedMlp::kBlockHidden;
    for (const int padded : kInputs)
      if (net.width[0] <= padded && padded < in && (padded != kCrowdInput || net.is_narrow())) in = padded;
  }
  bool operator==(const PolicyShape&) const = default;
};

/// Queues them; those that follow each other and have few rows in one launch. A network computes as the fused gradients
/// do (cuda/ppo_gradients.hpp), products, tanh and relu to the last bit, but for wide networks, whose gradients add up
/// in another order with another tanh; the action is drawn by the formulas of math/distributions.hpp. Throws
/// where the kernel does not serve a network. `behind_step`: nothing on the stream since the step that wrote the
/// observations, nor that step, writes parameters or `plays`; then they may be read before it has ended.
void launch_fused_policies(std::span<const FusedPolicy> policies, bool behind_step, int index, void* stream);

}  // namespace giga
