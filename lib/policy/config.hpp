// Settings of actors and critics.
#pragma once

#include <array>
#include <vector>

#include "config/fields.hpp"
#include "math/activation.hpp"

namespace giga {

/// Arithmetic of networks on the GPU. Parameters are fp32, and so is everything that is not mentioned here. fp16 is for
/// evolution: weights, biases, log_std and the inputs of each layer are rounded to half precision; sums are fp32.
/// TF32 multiplies such numbers exactly, so LibTorch can evaluate the mean in the same arithmetic. The fused kernel,
/// which plays the games of a population, differs only by its tanh (cuda/population_policy.hpp).
enum class Precision : uint8_t { fp32, tf32, bf16, fp16 };
constexpr std::array<const char*, 4> enum_names(Precision) { return {"fp32", "tf32", "bf16", "fp16"}; }
/// The precision in words.
constexpr const char* meaning_of(Precision precision) {
  constexpr const char* kMeanings[] = {"fp32",
                                       "factors of matrix products rounded to TF32 (10 bits of mantissa), sums in fp32",
                                       "weights and features in bfloat16, sums in fp32",
                                       "weights, biases and what a layer takes in rounded to half precision, sums in "
                                       "fp32; tanh within 2^-11 of its value"};
  return kMeanings[static_cast<size_t>(precision)];
}

/// Normalised observations are clamped to +- this.
constexpr float kNormalizedLimit = 10;
/// LibTorch adds this to the variance in a layer normalisation.
constexpr float kLayerNormEpsilon = 1e-5f;

/// The part of an observation that a network reads: everything, or the egocentric view alone (sim/egocentric_view.hpp).
enum class NetworkInputs : uint8_t { all, egocentric };
constexpr std::array<const char*, 2> enum_names(NetworkInputs) { return {"all", "egocentric"}; }
constexpr std::array<RenamedChoice, 1> renamed_choices(NetworkInputs) { return {{{"body", "egocentric"}}}; }

struct MlpConfig {
  std::vector<int> hidden = {64, 64};
  Activation activation = Activation::tanh;
  bool layer_norm = false;
  float hidden_gain = 1.41421356f;
};

/// The kinds of encoders by name. encoder.cpp has the table of what makes them; a kind with settings of its own adds
/// them to NetworkConfig.
enum class EncoderKind : uint8_t { mlp, nature, impala, compact };
constexpr std::array<const char*, 4> enum_names(EncoderKind) { return {"mlp", "nature", "impala", "compact"}; }
/// Whether an encoder reads the image of an agent; the others read its numbers.
constexpr bool reads_images(EncoderKind kind) { return kind != EncoderKind::mlp; }
/// Pixels of a side of the smallest image that the convolutions of `nature` fit on.
constexpr int kNatureSide = 36;

/// What a network remembers from step to step, behind its encoder: nothing, or the state of a recurrent cell
/// (math/recurrent.hpp).
enum class MemoryKind : uint8_t { none, gru, lstm };
constexpr std::array<const char*, 3> enum_names(MemoryKind) { return {"none", "gru", "lstm"}; }

/// What actors and critics have in common: the numbers that they read, and the encoder that turns them into features.
struct NetworkConfig : MlpConfig {
  NetworkInputs inputs = NetworkInputs::all;
  EncoderKind encoder = EncoderKind::mlp;
  MemoryKind memory = MemoryKind::none;
  int memory_size = 64;
  int impala_width = 16;

  bool remembers() const { return memory != MemoryKind::none; }
  bool reads_image() const { return reads_images(encoder); }
};

template <class V>
void visit_network_fields(V& v, NetworkConfig& c) {
  v("inputs", c.inputs,
    "what is read of an agent's numbers: all, or only the egocentric view (needs "
    "environment.observation.egocentric_view: true)");
  v("encoder", c.encoder,
    "network between what is read and the output layer; mlp: dense layers of the sizes in hidden, on numbers; nature "
    "(Mnih et al. 2015), impala (Espeholt et al. 2018) and compact (three small layers): convolutions on the agent's "
    "image, then such layers");
  v("impala_width", c.impala_width,
    "encoder impala: channels of its first section; the two behind it have twice as many", range(1, 512));
  v("hidden", c.hidden, "sizes of the hidden layers", range(1, 16384).items(1, 16));
  v("activation", c.activation, "nonlinearity after each hidden layer");
  v("layer_norm", c.layer_norm, "layer normalisation before each nonlinearity");
  v("hidden_gain", c.hidden_gain, "gain of the orthogonal initialisation of hidden layers", greater_than(0));
  v("memory", c.memory,
    "what the network remembers from step to step, between the encoder and the output layer, zero where an episode "
    "begins: none, or the state of a recurrent cell, gru or lstm");
  v("memory_size", c.memory_size,
    "numbers that the cell remembers and gives to the output layer (lstm: and its cell, "
    "as many again)",
    range(1, 4096));
}

/// The policy of a team: one network for all its agents, each fed its own observation.
struct ActorConfig : NetworkConfig {
  float output_gain = 0.01f;
  float log_std_init = -0.5f;
  float log_std_min = -5.0f, log_std_max = 1.0f;
};
template <class V>
void visit_fields(V& v, ActorConfig& c) {
  visit_network_fields(v, c);
  v("output_gain", c.output_gain, "gain of the initialisation of the output layer", at_least(0));
  v("log_std_init", c.log_std_init,
    "continuous actions: initial log of the standard deviation, between log_std_min and log_std_max", range(-10, 3));
  v("log_std_min", c.log_std_min,
    "continuous actions: least log of the standard deviation, after each pass over a rollout; evolution: of the mean, "
    "not of its members",
    range(-10, 3));
  v("log_std_max", c.log_std_max, "the largest, likewise: beyond 1 nearly all actions lie at the ends of their range",
    range(-10, 3));
}

enum class CriticKind : uint8_t { composed, state, independent };
constexpr std::array<const char*, 3> enum_names(CriticKind) { return {"composed", "state", "independent"}; }

/// The value function of a team, used in training only.
struct CriticConfig : NetworkConfig {
  CriticKind kind = CriticKind::composed;
  bool shared_encoder = false;
  float output_gain = 1.0f;
};
template <class V>
void visit_fields(V& v, CriticConfig& c) {
  v("kind", c.kind,
    "composed: local observations and, in each layer, the mean features of the team's living agents; one agent alone "
    "as with independent; state: the true state of the world; independent: local observations only (IPPO)");
  visit_network_fields(v, c);
  v("shared_encoder", c.shared_encoder,
    "read the features behind the actor's encoder, which then learns from both losses; the critic's own layers "
    "(hidden) and memory follow. false: it has an encoder of its own");
  v("output_gain", c.output_gain, "gain of the initialisation of the output layer", at_least(0));
}

}  // namespace giga
