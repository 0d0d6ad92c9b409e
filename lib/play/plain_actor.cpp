#include "play/plain_actor.hpp"

#include "core/error.hpp"
#include "export/actor_model.hpp"
#include "policy/config.hpp"

namespace giga {

// What plain_network.cpp takes them for.
static_assert(kNormalizedLimit == 10 && kLayerNormEpsilon == 1e-5f);

PlainNetwork plain_network_of(const Actor& actor, int inputs, bool greedy) {
  if (actor.reads_image())
    throw InputError("a page plays networks that read numbers only (encoder: mlp), and this one reads images");
  if (actor.network().encoder().layers().empty())
    throw InputError("a page computes policies of dense layers only (encoder: mlp)");
  const PolicyModel model = model_of(actor, inputs);
  PlainNetwork network;
  network.actions = model.shape.actions;
  network.greedy = greedy;
  network.half = actor.precision() == Precision::fp16;
  const auto tensor = [&](const std::string& name) { return array_values<float>(find_array(model.tensors, name)); };
  const auto rounded = [&](const std::string& name) {
    std::vector<float> values = tensor(name);
    if (network.half)
      for (float& value : values) value = rounded_to_half_precision(value);
    return values;
  };
  if (model.shape.normalizes) {
    network.mean = tensor(kMeanTensor);
    network.std = tensor(kStdTensor);
  }
  for (int k = 0; k < model.shape.n_layers(); ++k) {
    PlainLayer& layer = network.layers.emplace_back();
    layer.weight = rounded(layer_tensor(k, "weight"));
    layer.bias = rounded(layer_tensor(k, "bias"));
    if (!model.shape.is_hidden(k)) continue;
    layer.activation = model.shape.network.activation;
    if (!model.shape.network.layer_norm) continue;
    layer.norm_weight = tensor(layer_tensor(k, "norm_weight"));
    layer.norm_bias = tensor(layer_tensor(k, "norm_bias"));
  }
  if (model.shape.memory != MemoryKind::none)
    network.memory = {tensor(kInputWeightTensor), tensor(kInputBiasTensor), tensor(kHiddenWeightTensor),
                      tensor(kHiddenBiasTensor)};
  if (network.actions == ActionKind::continuous) network.log_std = rounded(kLogStdTensor);
  return network;
}

}  // namespace giga
