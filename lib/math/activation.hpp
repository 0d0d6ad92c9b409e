// Activations of networks.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "core/host_device.hpp"

namespace giga {

enum class Activation : uint8_t { tanh, relu, silu, gelu };
constexpr std::array<const char*, 4> enum_names(Activation) { return {"tanh", "relu", "silu", "gelu"}; }

/// As LibTorch computes them; gelu by the error function.
GIGA_HD float activate(Activation activation, float x) {
  switch (activation) {
    case Activation::tanh:
      return std::tanh(x);
    case Activation::relu:
      return x > 0 ? x : 0.0f;
    case Activation::silu:
      return x / (1.0f + std::exp(-x));
    case Activation::gelu:
      return 0.5f * x * (1.0f + std::erf(x * 0.70710678118654752440f));
  }
  return x;
}

struct Activated {
  float value, slope;
};
/// With the derivative at x.
GIGA_HD Activated activate_with_slope(Activation activation, float x) {
  const float value = activate(activation, x);
  switch (activation) {
    case Activation::tanh:
      return {value, 1.0f - value * value};
    case Activation::relu:
      return {value, x > 0 ? 1.0f : 0.0f};
    case Activation::silu: {
      const float sigmoid = 1.0f / (1.0f + std::exp(-x));
      return {value, sigmoid * (1.0f + x * (1.0f - sigmoid))};
    }
    case Activation::gelu: {
      const float density = 0.39894228040143267794f * std::exp(-0.5f * x * x);
      return {value, 0.5f * (1.0f + std::erf(x * 0.70710678118654752440f)) + x * density};
    }
  }
  return {value, 1.0f};
}

}  // namespace giga
