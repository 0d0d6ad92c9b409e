// The layers of encoders of images, relu(convolution + bias), each as one differentiable function.
#pragma once

#include <ATen/core/Tensor.h>

namespace giga {

/// Whether the kernels of the first layer (cuda/image_layer.hpp) serve such images [R, side, side, 3] and weights
/// [outputs, size * size * 3] by a stride of kPatch: bytes on a GPU.
bool image_layer_serves(const at::Tensor& images, const at::Tensor& weight, int64_t size);

/// relu(convolution + bias) of images in bytes, for pixels in [0, 1] -> [R, across, across, outputs] in bfloat16.
/// `centred`: the agent is moved to the middle of its image first. Differentiable in weight and bias.
at::Tensor image_layer(const at::Tensor& images, const at::Tensor& weight, const at::Tensor& bias, int64_t size,
                       bool centred);

/// relu(convolution + bias) of x [R, input, H, W] -> [R, output, H', W'], channels last, with weight [output, input,
/// size, size] and bias [output] of its type. In bfloat16 on a GPU, bias and ReLU take no pass of their own.
at::Tensor rectified_convolution(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias, int64_t stride,
                                 int64_t padding);

}  // namespace giga
