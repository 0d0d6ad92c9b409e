// Pure functions of lib/core evaluated on the GPU, for comparison with the CPU.
#pragma once

#include <cstdint>
#include <vector>

namespace giga::test {

/// Per angle: sine, cosine, wrap_original, wrap_angle, fmod_two_pi, square root of its size, 1 / itself.
constexpr int kNFunctions = 7;
constexpr const char* kFunctionNames[kNFunctions] = {"sin",         "cos",         "wrap_original", "wrap_angle",
                                                     "fmod_two_pi", "square root", "reciprocal"};
std::vector<float> functions_on_gpu(const std::vector<float>& angles);
std::vector<float> functions_on_cpu(const std::vector<float>& angles);

/// Draws of `n` worlds: DrawKey(seed, world, step).uniform(detect, row, index) for row, index < 5; the map of 7 maps;
/// all as floats.
constexpr int kDrawsPerWorld = 26;
std::vector<float> draws_on_gpu(uint64_t seed, int n_worlds, uint32_t step);
std::vector<float> draws_on_cpu(uint64_t seed, int n_worlds, uint32_t step);

}  // namespace giga::test
