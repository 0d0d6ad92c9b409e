#include "play/plain_network.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "math/recurrent.hpp"
#include "play/byte_stream.hpp"

namespace giga {
namespace {

// Those of lib/policy/config.hpp, which the module of a page does not see; plain_actor.cpp holds them to it.
constexpr float kInputLimit = 10, kNormEpsilon = 1e-5f;

/// W x + b.
std::vector<float> product(const std::vector<float>& weights, const std::vector<float>& bias,
                           std::span<const float> x) {
  std::vector<float> y = bias;
  const float* weight = weights.data();
  for (float& sum : y)
    for (const float value : x) sum += value * *weight++;
  return y;
}

/// One step of one row: features -> features. `state` becomes what is remembered after it.
std::vector<float> remember(const PlainMemory& memory, const std::vector<float>& x, float* state) {
  const auto size = static_cast<int64_t>(memory.size());
  const std::vector<float> input = product(memory.input_weight, memory.input_bias, x),
                           hidden = product(memory.hidden_weight, memory.hidden_bias, {state, memory.size()});
  std::vector<float> gates(4 * memory.size()), features(memory.size());
  // Each number of the state is read before it is written.
  float* const cell = state + size;
  const GruStep gru{size, input.data(), hidden.data(), state, nullptr, gates.data(), features.data(), state};
  const LstmStep lstm{size,         input.data(), hidden.data(),   cell,  nullptr,
                      gates.data(), cell,         features.data(), state, cell};
  for (int64_t k = 0; k < size; ++k) memory.is_lstm() ? lstm(k) : gru(k);
  return features;
}

void normalize_layer(const PlainLayer& layer, std::vector<float>& x) {
  double sum = 0, squares = 0;
  for (const float value : x) sum += static_cast<double>(value);
  const double mean = sum / static_cast<double>(x.size());
  for (const float value : x) squares += (static_cast<double>(value) - mean) * (static_cast<double>(value) - mean);
  const double scale = 1 / std::sqrt(squares / static_cast<double>(x.size()) + static_cast<double>(kNormEpsilon));
  for (size_t k = 0; k < x.size(); ++k)
    x[k] = static_cast<float>((static_cast<double>(x[k]) - mean) * scale) * layer.norm_weight[k] + layer.norm_bias[k];
}

}  // namespace

float rounded_to_half_precision(float x) {
  if (!(std::fabs(x) < 65520.0f)) return std::isnan(x) ? x : std::copysign(INFINITY, x);
  int exponent = 0;
  std::frexp(x, &exponent);
  // 11 bits of mantissa; below 2^-14 the last of them stays at 2^-24.
  const float unit = std::ldexp(1.0f, std::max(exponent, -13) - 11);
  return std::nearbyint(x / unit) * unit;
}

void PlainNetwork::forward(const float* row, float* state, float* head) const {
  std::vector<float> x(row, row + inputs());
  for (size_t k = 0; k < mean.size(); ++k) x[k] = std::clamp((x[k] - mean[k]) / std[k], -kInputLimit, kInputLimit);
  for (const PlainLayer& layer : layers) {
    if (&layer == &layers.back() && memory.size() > 0) x = remember(memory, x, state);
    if (half)
      for (float& value : x) value = rounded_to_half_precision(value);
    x = product(layer.weight, layer.bias, x);
    if (!layer.norm_weight.empty()) normalize_layer(layer, x);
    if (layer.activation)
      for (float& value : x) value = activate(*layer.activation, value);
  }
  std::copy(x.begin(), x.end(), head);
}

std::string network_bytes(const PlainNetwork& network) {
  ByteWriter out;
  out.put(network.actions);
  out.put(network.greedy);
  out.put(network.half);
  out.put_all(network.mean);
  out.put_all(network.std);
  out.put_all(network.log_std);
  out.put(static_cast<uint32_t>(network.layers.size()));
  for (const PlainLayer& layer : network.layers) {
    out.put(layer.activation ? static_cast<int32_t>(*layer.activation) : -1);
    out.put_all(layer.weight);
    out.put_all(layer.bias);
    out.put_all(layer.norm_weight);
    out.put_all(layer.norm_bias);
  }
  for (const auto* part : {&network.memory.input_weight, &network.memory.input_bias, &network.memory.hidden_weight,
                           &network.memory.hidden_bias})
    out.put_all(*part);
  return out.take();
}

PlainNetwork read_network(std::string_view bytes) {
  ByteReader in(bytes);
  PlainNetwork network;
  network.actions = in.get<ActionKind>();
  network.greedy = in.get<bool>();
  network.half = in.get<bool>();
  network.mean = in.get_all<float>();
  network.std = in.get_all<float>();
  network.log_std = in.get_all<float>();
  network.layers.resize(in.get<uint32_t>());
  for (PlainLayer& layer : network.layers) {
    const auto activation = in.get<int32_t>();
    if (activation >= 0) layer.activation = static_cast<Activation>(activation);
    layer.weight = in.get_all<float>();
    layer.bias = in.get_all<float>();
    layer.norm_weight = in.get_all<float>();
    layer.norm_bias = in.get_all<float>();
  }
  for (auto* part : {&network.memory.input_weight, &network.memory.input_bias, &network.memory.hidden_weight,
                     &network.memory.hidden_bias})
    *part = in.get_all<float>();
  GIGA_CHECK(in.at_end() && !network.layers.empty(), "bytes of a network");
  return network;
}

}  // namespace giga
