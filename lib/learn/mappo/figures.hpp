// What an update of mappo reports of a team: figures, and faults where a number is not finite. All stay on the device
// until they are read together.
#pragma once

#include <array>

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
  kFigActorNorm,  // sums over minibatches
  kFigCriticNorm,
  kFigSkipped,
  kFigFirstRatioError,    // mean of the first minibatch: 0 where rollout and update agree
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
  kNFaults
};
constexpr std::array<const char*, kNFaults> kPpoFaultNames = {
    "observations",          "log-probabilities of actions", "rewards", "values", "advantages", "returns",
    "gradient of the actor", "gradient of the critic"};
/// The faults follow the figures.
constexpr int kFirstFault = kNPpoFigures, kNFigures = kFirstFault + kNFaults;

}  // namespace giga
