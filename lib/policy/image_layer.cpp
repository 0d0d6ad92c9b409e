#include "policy/image_layer.hpp"

#include <torch/autograd.h>
#include <torch/types.h>

#include "cuda/halving_layer.hpp"
#include "cuda/image_layer.hpp"
#include "cuda/relu_gradient.hpp"
#include "policy/run_elementwise.hpp"

namespace giga {
namespace {

BFloat16* numbers(const at::Tensor& x) { return static_cast<BFloat16*>(x.data_ptr()); }
int gpu_of(const at::Tensor& x) { return static_cast<int>(x.device().index()); }

struct ImageLayerFunction : torch::autograd::Function<ImageLayerFunction> {
  static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& images,
                            const at::Tensor& weight, const at::Tensor& bias, int64_t size, bool centred) {
    ImageLayer layer = layer_of(images, size, centred);
    layer.weight = weight.const_data_ptr<float>();
    layer.bias = bias.const_data_ptr<float>();
    const at::Tensor output = at::empty({layer.n, layer.across(), layer.across(), ImageLayer::kOutputs},
                                        images.options().dtype(at::kBFloat16));
    launch_image_layer(layer, numbers(output), gpu_of(images), libtorch_stream(images));
    context->save_for_backward({images, output});
    context->saved_data["size"] = size;
    context->saved_data["centred"] = centred;
    return output;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 const torch::autograd::variable_list& gradients) {
    const torch::autograd::variable_list saved = context->get_saved_variables();
    const at::Tensor images = saved[0], output = saved[1], d_output = gradients[0].contiguous();
    const ImageLayer layer =
        layer_of(images, context->saved_data["size"].toInt(), context->saved_data["centred"].toBool());
    const at::Tensor parts =
        at::empty({image_layer_parts(gpu_of(images)), layer.gradients()}, images.options().dtype(at::kFloat));
    launch_image_layer_gradient(layer, numbers(output), numbers(d_output), parts.data_ptr<float>(), gpu_of(images),
                                libtorch_stream(images));
    const at::Tensor sum = parts.sum(0);
    const int64_t weights = int64_t{ImageLayer::kOutputs} * layer.window();
    return {at::Tensor(), sum.narrow(0, 0, weights).view({ImageLayer::kOutputs, layer.window()}),
            sum.narrow(0, weights, ImageLayer::kOutputs), at::Tensor(), at::Tensor()};
  }

 private:
  static ImageLayer layer_of(const at::Tensor& images, int64_t size, bool centred) {
    return {.images = images.const_data_ptr<uint8_t>(),
            .n = images.size(0),
            .side = static_cast<int>(images.size(1)),
            .size = static_cast<int>(size),
            .centred = centred};
  }
};

/// LibTorch would take a pass each over the output for the bias and for ReLU, and one each over its gradient.
struct RectifiedConvolutionFunction : torch::autograd::Function<RectifiedConvolutionFunction> {
  static at::Tensor forward(torch::autograd::AutogradContext* context, const at::Tensor& x, const at::Tensor& weight,
                            const at::Tensor& bias, int64_t stride, int64_t padding) {
    const at::Tensor output = at::cudnn_convolution_relu(x, weight, bias, at::IntArrayRef{stride, stride},
                                                         at::IntArrayRef{padding, padding}, at::IntArrayRef{1, 1}, 1);
    GIGA_CHECK(output.is_contiguous(at::MemoryFormat::ChannelsLast), "channels that are not last");
    context->save_for_backward({x, weight, output});
    context->saved_data["stride"] = stride;
    context->saved_data["padding"] = padding;
    return output;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 const torch::autograd::variable_list& gradients) {
    const torch::autograd::variable_list saved = context->get_saved_variables();
    const at::Tensor x = saved[0], weight = saved[1], output = saved[2],
                     d_output = gradients[0].contiguous(at::MemoryFormat::ChannelsLast);
    const int64_t stride = context->saved_data["stride"].toInt(), padding = context->saved_data["padding"].toInt();
    if (HalvingLayer::serves(x.size(2), x.size(1), output.size(1), weight.size(2), stride, padding) &&
        x.size(2) == x.size(3) && image_layer_runs(gpu_of(x)))
      return gradients_of_halving(x, weight, output, d_output);
    const int64_t columns = output.size(1);
    const at::Tensor d_sums = at::empty_like(output);
    const at::Tensor parts =
        at::empty({relu_gradient_parts(gpu_of(output)), columns}, output.options().dtype(at::kFloat));
    launch_relu_gradient({.rows = output.numel() / columns,
                          .columns = static_cast<int>(columns),
                          .output = numbers(output),
                          .d_output = numbers(d_output),
                          .d_input = numbers(d_sums),
                          .parts = parts.data_ptr<float>()},
                         gpu_of(output), libtorch_stream(output));
    const auto [d_x, d_weight, none] =
        at::convolution_backward(d_sums, x, weight, at::OptionalIntArrayRef(), at::IntArrayRef{stride, stride},
                                 at::IntArrayRef{padding, padding}, at::IntArrayRef{1, 1}, false, at::IntArrayRef{0, 0},
                                 1, {context->needs_input_grad(0), context->needs_input_grad(1), false});
    return {d_x, d_weight, parts.sum(0).to(at::kBFloat16), at::Tensor(), at::Tensor()};
  }

 private:
  /// cuDNN took 790 us for the products and LibTorch 120 us for ReLU and bias, of 10,240 images of 21 x 21 and 11 x 11
  /// (one H200); the least that memory allows are 200 us.
  static torch::autograd::variable_list gradients_of_halving(const at::Tensor& input, const at::Tensor& weights,
                                                             const at::Tensor& output, const at::Tensor& d_output) {
    const at::Tensor x = input.contiguous(at::MemoryFormat::ChannelsLast),
                     weight = weights.contiguous(at::MemoryFormat::ChannelsLast), d_x = at::empty_like(x);
    const at::Tensor parts =
        at::empty({halving_layer_parts(gpu_of(x)), HalvingLayer::kGradients}, x.options().dtype(at::kFloat));
    launch_halving_layer_gradient({.n = x.size(0),
                                   .side = static_cast<int>(x.size(2)),
                                   .input = numbers(x),
                                   .weight = numbers(weight),
                                   .output = numbers(output),
                                   .d_output = numbers(d_output),
                                   .d_input = numbers(d_x),
                                   .parts = parts.data_ptr<float>()},
                                  gpu_of(x), libtorch_stream(x));
    const at::Tensor sum = parts.sum(0).to(at::kBFloat16);
    constexpr int64_t kChannels = HalvingLayer::kChannels, kSize = HalvingLayer::kSize;
    const int64_t weight_numbers = HalvingLayer::kGradients - kChannels;
    return {d_x, sum.narrow(0, 0, weight_numbers).view({kChannels, kSize, kSize, kChannels}).permute({0, 3, 1, 2}),
            sum.narrow(0, weight_numbers, kChannels), at::Tensor(), at::Tensor()};
  }
};

}  // namespace

bool image_layer_serves(const at::Tensor& images, const at::Tensor& weight, int64_t size) {
  return images.is_cuda() && images.scalar_type() == at::kByte && images.size(3) == kChannels &&
         ImageLayer::serves(images.size(1), size, weight.size(0)) && image_layer_runs(gpu_of(images));
}

at::Tensor image_layer(const at::Tensor& images, const at::Tensor& weight, const at::Tensor& bias, int64_t size,
                       bool centred) {
  return ImageLayerFunction::apply(images, weight, bias, size, centred);
}

at::Tensor rectified_convolution(const at::Tensor& x, const at::Tensor& weight, const at::Tensor& bias, int64_t stride,
                                 int64_t padding) {
  if (x.is_cuda() && x.scalar_type() == at::kBFloat16 && x.size(0) > 0 && ReluGradient::serves(weight.size(0)))
    return RectifiedConvolutionFunction::apply(x, weight, bias, stride, padding);
  return at::relu(at::conv2d(x, weight, bias, at::IntArrayRef{stride, stride}, at::IntArrayRef{padding, padding}));
}

}  // namespace giga
