// The list of all elementwise operations: what elementwise.cu makes for a GPU, and a build without CUDA leaves out.
#pragma once

#include "math/copy_pieces.hpp"
#include "math/dense_epilogue.hpp"
#include "math/dense_rows.hpp"
#include "math/distributions.hpp"
#include "math/es_noise.hpp"
#include "math/forget_episodes.hpp"
#include "math/gae.hpp"
#include "math/image_patches.hpp"
#include "math/population_actions.hpp"
#include "math/ppo_figures.hpp"
#include "math/ppo_loss.hpp"
#include "math/recurrent.hpp"
#include "math/step_gate.hpp"
#include "math/team_mean.hpp"
#include "scripted/actions.hpp"
#include "scripted/population_scripts.hpp"

#define GIGA_ELEMENTWISE(APPLY)       \
  APPLY(SampleCategorical)            \
  APPLY(SampleGaussian)               \
  APPLY(ScriptedActions)              \
  APPLY(BlindActions)                 \
  APPLY(ForgetEpisodes)               \
  APPLY(CopyPieces)                   \
  APPLY(DenseRows)                    \
  APPLY(DenseEpilogue)                \
  APPLY(DenseEpilogueGradient)        \
  APPLY(Gae)                          \
  APPLY(CategoricalLoss)              \
  APPLY(GaussianLoss)                 \
  APPLY(ValueLoss)                    \
  APPLY(PopulationActions)            \
  APPLY(PopulationScriptsOfAll)       \
  APPLY(PerturbMembers)               \
  APPLY(NoiseMoments)                 \
  APPLY(SumOfParts)                   \
  APPLY(FiniteCheck)                  \
  APPLY(StepGate)                     \
  APPLY(AdamStep)                     \
  APPLY(PolicyNote)                   \
  APPLY(GruStep)                      \
  APPLY(GruStepGradient)              \
  APPLY(LstmStep)                     \
  APPLY(LstmStepGradient)             \
  APPLY(LivingMean<float>)            \
  APPLY(LivingMean<BFloat16>)         \
  APPLY(LivingMeanGradient<float>)    \
  APPLY(LivingMeanGradient<BFloat16>) \
  APPLY(OwnPixels<uint8_t>)           \
  APPLY(OwnPixels<float>)             \
  APPLY(OwnPixels<BFloat16>)          \
  APPLY(ImagePatches<uint8_t>)        \
  APPLY(ImagePatches<float>)          \
  APPLY(ImagePatches<BFloat16>)
