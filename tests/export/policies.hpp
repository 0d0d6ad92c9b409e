// What the export tests share: a scenario whose observations are padded, and actors of every kind for it.
#pragma once

#include <torch/types.h>

#include <string>
#include <vector>

#include "export/manifest.hpp"
#include "policy/actor.hpp"

namespace giga::test {

/// 2 against 2 with a waypoint and two boxes: observations of 4 x 9 + 5 + 2 x 4 = 49 numbers, padded to 56.
SimSpec small_spec(ActionKind actions);
constexpr int kInputs = 49, kPaddedInputs = 56;
/// The same with the egocentric view, which begins at 56: 7 + 12 + 3 + 3 x 8 = 46 numbers.
SimSpec small_spec_with_view(ActionKind actions);

struct ActorKind {
  ActionKind actions = ActionKind::discrete;
  Activation activation = Activation::tanh;
  bool layer_norm = false, normalizes = false;
  bool reads_part = false;  ///< columns 8 to 47 only
  MemoryKind memory = MemoryKind::none;
  EncoderKind encoder = EncoderKind::mlp;

  /// Pixels of the images that it reads: as few as the convolutions of nature fit on; an odd number.
  int image_side() const { return encoder == EncoderKind::nature ? kNatureSide : 11; }
  std::string name() const;  ///< "discrete_tanh_layer_norm"
};
/// All 2 x 4 x 2 x 2 that read everything; and one of each kind of action that reads a part, and with each memory.
std::vector<ActorKind> all_kinds();

/// Three that read images: nature and compact with discrete actions; impala with continuous ones and a memory.
std::vector<ActorKind> image_kinds();
/// small_spec whose agents are given images alone.
SimSpec small_spec_with_images(const ActorKind& kind);
/// [rows, side side 3] of bytes.
at::Tensor varied_images(int64_t rows, int side);

/// A random actor for small_spec_with_view, which reads the view alone (`reads_part`) or everything.
Actor make_actor_with_view(const ActorKind& kind);

/// Hidden layers of 12 and 10; every parameter, biases too, is random, and so are the moments of the normaliser.
Actor make_random_actor(const ActorKind& kind);

/// [rows, kPaddedInputs], of mean 2 and deviation 3; zeros behind column kInputs.
at::Tensor random_observations(int64_t rows);

/// Rows of all agents in games with discrete actions that are drawn, every eighth step: [rows, observation_size()].
at::Tensor played_rows(SimSpec spec, int64_t n_rows);

/// Such rows as networks read them, with zeros behind.
at::Tensor padded(const at::Tensor& rows, const SimSpec& spec);

/// What a policy gives at the third step in which it sees the same; without memory as at the first.
at::Tensor third_head(const Policy& policy, const at::Tensor& obs);

/// Of team 1 after 12 updates.
PolicyOrigin sample_origin();

}  // namespace giga::test
