// Layers of encoders of images by their kernels against LibTorch in fp32: outputs, gradients, repetition.
#include "policy/image_layer.hpp"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <utility>

#include "cuda/runtime.hpp"
#include "policy/convolution.hpp"

namespace giga::test {
namespace {

struct Layer {
  int64_t size, across;
  at::Tensor weight, bias;  // with gradients

  Layer(int64_t side, int64_t size_, at::Device device) : size(size_), across((side - size) / 4 + 1) {
    const int64_t n = 32 * size * size * 3;
    weight = ((at::arange(n) * 29 % 101).to(at::kFloat) / 101 - 0.5).view({32, -1}).to(device).requires_grad_();
    bias = ((at::arange(32) * 7 % 32).to(at::kFloat) / 32 - 0.4).to(device).requires_grad_();
  }
  /// images [R, side, side, 3] -> [R, across, across, 32], in fp32.
  at::Tensor plain(const at::Tensor& images) const {
    const at::Tensor x = images.permute({0, 3, 1, 2}).to(at::kFloat) / 255;
    const at::Tensor w = weight.view({32, size, size, 3}).permute({0, 3, 1, 2});
    return at::relu(at::conv2d(x, w, bias, at::IntArrayRef{4, 4})).permute({0, 2, 3, 1});
  }
};

/// Images with an agent each, but the first. Of two pixels of its own the one with the larger x counts.
at::Tensor some_images(int64_t n, int64_t side) {
  at::Tensor images = (at::arange(n * side * side * 3) * 37 % 251).to(at::kByte).view({n, side, side, 3});
  for (int64_t k = 1; k < n; ++k) {
    const int64_t x = k * 11 % side, y = (side - 1 - k * 5 % side);
    images[k][x][y] = at::tensor({100, 255, 100}, at::kByte);
    images[k][x / 2][y] = at::tensor({90, 255, 90}, at::kByte);  // of an earlier column
  }
  return images;
}
at::Tensor moved(const at::Tensor& images) {
  const int64_t n = images.size(0), side = images.size(1), middle = side / 2;
  at::Tensor all = images.clone();
  for (int64_t k = 1; k < n; ++k) {
    const int64_t dx = k * 11 % side - middle, dy = side - 1 - k * 5 % side - middle;
    all[k].zero_();
    const auto first = [](int64_t d) { return std::max<int64_t>(0, -d); };
    const auto count = [&](int64_t d) { return side - std::abs(d); };
    const auto part = [&](const at::Tensor& of, int64_t x, int64_t y) {
      return of.narrow(0, x, count(dx)).narrow(1, y, count(dy));
    };
    part(all[k], first(dx), first(dy)).copy_(part(images[k], first(dx) + dx, first(dy) + dy));
  }
  return all;
}

TEST(PolicyImageLayer, IsOfImagesOnAGpu) {
  const Layer layer(36, 4, at::kCPU);
  EXPECT_FALSE(image_layer_serves(some_images(2, 36), layer.weight, 4));
}

TEST(PolicyImageLayerGpu, AsConvolutionsInFp32) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const at::Device gpu(at::kCUDA, 0);
  for (const int64_t side : {36, 84, 128})
    for (const int64_t size : {4, 8})
      for (const bool centred : {false, true}) {
        SCOPED_TRACE(testing::Message() << side << " pixels, windows of " << size << (centred ? ", centred" : ""));
        const int64_t n = side == 36 ? 1031 : 7;  // more than blocks of a launch, or fewer
        const at::Tensor bytes = some_images(n, side), images = bytes.to(gpu);
        const Layer plain(side, size, at::kCPU), ours(side, size, gpu);
        ASSERT_TRUE(image_layer_serves(images, ours.weight, size));
        const at::Tensor expected = plain.plain(centred ? moved(bytes) : bytes);
        const at::Tensor output = image_layer(images, ours.weight, ours.bias, size, centred);
        ASSERT_EQ(output.sizes(), at::IntArrayRef({n, ours.across, ours.across, 32}));
        // Rounded to 8 bits of mantissa; weights to 11.
        const at::Tensor off = (output.to(at::kFloat).cpu() - expected).abs();
        EXPECT_LT(off.max().item<float>(), 0.005f * expected.max().item<float>());
        EXPECT_GT(expected.max().item<float>(), 0.1f);

        // Rows with a positive output where the other one is 0 differ by rounding alone: they get no gradient.
        const at::Tensor sure = (output.detach().cpu() > 0) == (expected.detach() > 0);
        const at::Tensor d = ((at::arange(expected.numel()) * 17 % 97).to(at::kFloat) / 97 - 0.5).view_as(expected);
        const at::Tensor d_output = (d * sure).to(at::kBFloat16);
        expected.backward(d_output.to(at::kFloat));
        output.backward(d_output.to(gpu));
        for (const auto& [got, wanted] : {std::pair{ours.weight, plain.weight}, std::pair{ours.bias, plain.bias}}) {
          const at::Tensor difference = (got.grad().cpu() - wanted.grad()).abs();
          EXPECT_LT(difference.max().item<float>(), 1e-4f * wanted.grad().abs().max().item<float>());
        }

        const at::Tensor first = ours.weight.grad().clone();
        ours.weight.mutable_grad() = at::Tensor();
        const at::Tensor again = image_layer(images, ours.weight, ours.bias, size, centred);
        EXPECT_TRUE(at::equal(again, output));
        again.backward(d_output.to(gpu));
        EXPECT_TRUE(at::equal(ours.weight.grad(), first));
      }
}

// What the memory of its output held before means nothing to it: it is filled with NaN here.
TEST(PolicyRectifiedConvolutionGpu, AsConvolutionsInFp32) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  const bool tf32 = at::globalContext().allowTF32CuDNN();
  at::globalContext().setAllowTF32CuDNN(false);
  struct Shape {
    int64_t n, input, output, side, size, stride, padding;
  };
  for (const Shape& s :
       {Shape{5120, 32, 64, 20, 4, 2, 0}, Shape{10240, 64, 64, 9, 3, 1, 0}, Shape{10240, 32, 32, 21, 3, 2, 1},
        Shape{5120, 32, 32, 11, 3, 2, 1}, Shape{7, 32, 32, 24, 3, 2, 1}, Shape{3, 32, 32, 5, 3, 2, 1},
        Shape{7, 32, 32, 25, 3, 2, 1}, Shape{7, 16, 16, 5, 3, 1, 1}}) {
    SCOPED_TRACE(testing::Message() << s.n << " of " << s.input << " channels, " << s.side << " pixels");
    const at::Tensor numbers = (at::arange(s.n * s.input * s.side * s.side) * 37 % 97).to(at::kFloat) / 97;
    const at::Tensor images = numbers.view({s.n, s.side, s.side, s.input})
                                  .to(at::Device(at::kCUDA, 0))
                                  .to(at::kBFloat16)
                                  .permute({0, 3, 1, 2});
    const at::Tensor weights = (at::arange(s.output * s.size * s.size * s.input) * 29 % 101).to(at::kFloat) / 101 - 0.5;
    const at::Tensor weight =
        weights.view({s.output, s.size, s.size, s.input}).to(images.device()).to(at::kBFloat16).permute({0, 3, 1, 2});
    const at::Tensor bias = (at::arange(s.output).to(at::kFloat) / 8 - 2).to(images.device()).to(at::kBFloat16);
    const auto leaf = [](const at::Tensor& x, at::ScalarType type) {
      return x.detach().to(type, false, true, at::MemoryFormat::Preserve).requires_grad_();
    };
    const at::Tensor x = leaf(images, at::kFloat), w = leaf(weight, at::kFloat), b = leaf(bias, at::kFloat);
    const at::Tensor expected =
        at::relu(at::conv2d(x, w, b, at::IntArrayRef{s.stride, s.stride}, at::IntArrayRef{s.padding, s.padding}));
    const at::Tensor own_x = leaf(images, at::kBFloat16), own_w = leaf(weight, at::kBFloat16),
                     own_b = leaf(bias, at::kBFloat16);
    at::full(expected.sizes(), NAN, images.options());  // freed at once
    const at::Tensor output = rectified_convolution(own_x, own_w, own_b, s.stride, s.padding);
    const auto off = [](const at::Tensor& got, const at::Tensor& wanted) {
      return ((got.to(at::kFloat) - wanted).abs().max() / wanted.abs().max()).item<float>();
    };
    EXPECT_LT(off(output, expected), 0.005f);

    const at::Tensor sure = (output.detach() > 0) == (expected.detach() > 0);
    const at::Tensor d = ((at::arange(expected.numel(), x.options()) * 17).remainder(97) / 97 - 0.5)
                             .view({expected.size(0), expected.size(2), expected.size(3), expected.size(1)});
    const at::Tensor d_output = (d.permute({0, 3, 1, 2}) * sure).to(at::kBFloat16);
    expected.backward(d_output.to(at::kFloat));
    output.backward(d_output);
    EXPECT_LT(off(own_x.grad(), x.grad()), 0.01f);
    EXPECT_LT(off(own_w.grad(), w.grad()), 0.01f);
    EXPECT_LT(off(own_b.grad(), b.grad()), 0.01f);

    // A run repeats: no kernel adds up in any order, cuDNN's neither.
    const at::Tensor d_x = own_x.grad().clone(), d_w = own_w.grad().clone(), d_b = own_b.grad().clone();
    for (int again = 0; again < 3; ++again) {
      for (const at::Tensor& leaf_again : {own_x, own_w, own_b}) leaf_again.mutable_grad() = at::Tensor();
      const at::Tensor once_more = rectified_convolution(own_x, own_w, own_b, s.stride, s.padding);
      EXPECT_TRUE(at::equal(once_more, output));
      once_more.backward(d_output);
      EXPECT_TRUE(at::equal(own_x.grad(), d_x) && at::equal(own_w.grad(), d_w) && at::equal(own_b.grad(), d_b));
    }
  }
  at::globalContext().setAllowTF32CuDNN(tf32);
}

}  // namespace
}  // namespace giga::test
