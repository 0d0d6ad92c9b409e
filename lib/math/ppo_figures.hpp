// What an update of mappo reports of a team: figures, and faults where a number is not finite. All stay on the device
// until they are read together.
#pragma once

#include <array>
#include <cstdint>

#include "core/host_device.hpp"
#include "math/ppo_loss.hpp"

namespace giga {

/// Most are sums over the minibatches.
enum PpoFigure : int {
  kFigPolicyLoss,  // the first six: sums over living rows of all minibatches, see PolicyDiagnostic
  kFigEntropy,
  kFigKl,
  kFigClipped,
  kFigRatioError,
  kFigRows,
  kFigValueLoss,  // sum over living rows
  kFigViewLoss,   // sum over living rows; 0 without mappo.view_coef
  kFigActorNorm,  // sums over minibatches
  kFigCriticNorm,
  kFigViewNorm,
  kFigSkipped,
  kFigFirstRatioError,    // mean of the first minibatch: 0 where rollout and update agree, unless the other
                          // team, whose policy it is too, has taken a step before
  kFigExplained,          // explained variance of the values before the update
  kFigMutualInformation,  // I(obs; action) on the first minibatch
  kFigLiving,             // share of rows with a living agent
  kFigLastKl,             // mean of the last minibatch
  kNPpoFigures
};

/// Tensors that are searched for NaNs and infinities, each before the tensors that it would spoil. The figure is 0 if
/// all numbers are finite; else 1, for a gradient the number of the minibatch, from 1.
enum PpoFault : int {
  kFaultObservations,
  kFaultLogProbs,
  kFaultRewards,
  kFaultValues,
  kFaultAdvantages,
  kFaultReturns,
  kFaultActorGradient,
  kFaultCriticGradient,
  kFaultViewGradient,
  kNFaults
};
constexpr std::array<const char*, kNFaults> kPpoFaultNames = {"observations",
                                                              "log-probabilities of actions",
                                                              "rewards",
                                                              "values",
                                                              "advantages",
                                                              "returns",
                                                              "gradient of the actor",
                                                              "gradient of the critic",
                                                              "gradient of the view"};
/// The faults follow the figures.
constexpr int kFirstFault = kNPpoFigures, kNFigures = kFirstFault + kNFaults;

/// What a minibatch of a policy adds to the figures, and whether the others of the update are skipped (n = 1).
struct PolicyNote {
  const float* sums;       // [kNPolicyDiagnostics] over its living rows
  float* figures;          // [kNFigures]
  float* stop;             // [1] becomes 1 once the policy has moved further than target_kl
  float target_kl;         // below 0: as far as it will
  const float* minibatch;  // [1] its number within the update, from 1

  GIGA_HD void operator()(int64_t) const {
    static_assert(kFigRows + 1 == kNPolicyDiagnostics);
    for (int k = 0; k < kNPolicyDiagnostics; ++k) figures[k] += sums[k];
    const float rows = sums[kLossCount] > 1 ? sums[kLossCount] : 1;
    figures[kFigLastKl] = sums[kLossKl] / rows;
    if (*minibatch == 1) figures[kFigFirstRatioError] = sums[kLossRatioError] / rows;
    if (target_kl >= 0 && figures[kFigLastKl] > target_kl) *stop = 1;
    figures[kFigSkipped] += *stop;
  }
};

}  // namespace giga
