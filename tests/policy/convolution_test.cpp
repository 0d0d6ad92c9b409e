// Encoders of images: shapes and counts by arithmetic, bytes against numbers, and gradients.
#include "policy/convolution.hpp"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

#include "cuda/runtime.hpp"
#include "io/temporary_folder.hpp"

namespace giga::test {
namespace {

NetworkConfig cnn_config(std::vector<int> hidden) {
  NetworkConfig config;
  config.hidden = std::move(hidden);
  config.activation = Activation::relu;
  return config;
}

struct MadeEncoder {
  ParameterSet parameters;
  std::shared_ptr<const Encoder> encoder;

  MadeEncoder(EncoderFactory* make, int side, const NetworkConfig& config, at::Device device = at::kCPU) {
    encoder = make(parameters, "eye", ObservationShape(side, side, 3), config);
    parameters.allocate(device, 1);
  }
  at::Tensor operator()(const at::Tensor& x, Rounding rounding = Rounding::none) const {
    return encoder->forward(parameters, x, rounding);
  }
};

at::Tensor byte_images(at::IntArrayRef rows, int side) {
  std::vector<int64_t> shape = rows.vec();
  shape.push_back(int64_t{side} * side * 3);
  int64_t n = 1;
  for (const int64_t s : shape) n *= s;
  return (at::arange(n) * 37 % 251).to(at::kByte).view(shape);
}

TEST(PolicyNature, ParametersByArithmetic) {
  // 84 -> (84 - 8) / 4 + 1 = 20 -> (20 - 4) / 2 + 1 = 9 -> 9 - 2 = 7: 64 x 7 x 7 = 3136 numbers go to 512.
  const MadeEncoder made(make_nature, 84, cnn_config({512}));
  EXPECT_EQ(made.parameters.size(), (3 * 64 * 32 + 32) + (32 * 16 * 64 + 64) + (64 * 9 * 64 + 64) + (3136 * 512 + 512));
  EXPECT_EQ(made.parameters.size(), 1'682'080);
  EXPECT_EQ(made.encoder->features(), 512);
  EXPECT_EQ(made(byte_images({2, 5}, 84)).sizes(), at::IntArrayRef({2, 5, 512}));
}

TEST(PolicyNature, TheSmallestImage) {
  // 36 -> 8 -> 3 -> 1.
  const MadeEncoder made(make_nature, kNatureSide, cnn_config({16, 7}));
  EXPECT_EQ(made(byte_images({3}, kNatureSide)).sizes(), at::IntArrayRef({3, 7}));
  EXPECT_EQ(made.parameters.shape(6), (std::vector<int64_t>{16, 64}));
  const std::string message = input_error_of([] { MadeEncoder(make_nature, kNatureSide - 1, cnn_config({16})); });
  EXPECT_EQ(message, "the encoder nature needs images of at least 36 x 36 pixels; these have 35 x 35");
}

TEST(PolicyCompact, ParametersByArithmetic) {
  // 84 -> 84 / 4 = 21 -> 11 -> 6: 32 x 6 x 6 = 1152 numbers go to 64.
  const MadeEncoder made(make_compact, 84, cnn_config({64}));
  EXPECT_EQ(made.parameters.size(), (3 * 16 * 32 + 32) + 2 * (32 * 9 * 32 + 32) + (1152 * 64 + 64));
  EXPECT_EQ(made.parameters.size(), 93'856);
  EXPECT_EQ(made(byte_images({2, 5}, 84)).sizes(), at::IntArrayRef({2, 5, 64}));
  // 11 -> 2 -> 1 -> 1.
  EXPECT_EQ(MadeEncoder(make_compact, 11, cnn_config({7}))(byte_images({3}, 11)).sizes(), at::IntArrayRef({3, 7}));
}

// An agent (255 - 155, 255, 255 - 155) and an opponent that lies 5 to its right and 2 below: the features are the same
// wherever both are, as long as both are in the picture; where no pixel is the agent's own, the image stays as it is.
TEST(PolicyCompact, WhereTheAgentIsDoesNotMatter) {
  at::NoGradGuard no_grad;
  const int side = 41;
  const MadeEncoder made(make_compact, side, cnn_config({16}));
  const auto draw = [&](at::Tensor image, int x, int y, int r, int g, int b) {
    image[x][y] = at::tensor({r, g, b}, at::kByte);
  };
  at::Tensor images = at::zeros({5, side, side, 3}, at::kByte);
  const int places[][2] = {{20, 20}, {3, 9}, {30, 38}, {0, 2}};
  for (int k = 0; k < 4; ++k) {
    draw(images[k], places[k][0], places[k][1], 100, 255, 100);
    draw(images[k], places[k][0] + 5, places[k][1] - 2, 255, 90, 0);
  }
  // What is no agent's own: white, the green of health, gray, another colour.
  draw(images[4], 25, 18, 255, 90, 0);
  draw(images[4], 1, 1, 255, 255, 255);
  draw(images[4], 2, 1, 0, 255, 0);
  draw(images[4], 3, 1, 127, 127, 127);
  draw(images[4], 4, 1, 100, 255, 101);
  const at::Tensor features = made(images.view({5, -1}));
  for (int k = 1; k < 4; ++k) EXPECT_TRUE(at::equal(features[0], features[k])) << k;
  at::Tensor moved = images[4].clone();
  draw(moved, 0, 0, 100, 255, 100);  // moves it by (20, 20)
  EXPECT_FALSE(at::equal(features[4], made(moved.view({1, -1}))[0]));
  at::Tensor middle = images[4].clone();
  draw(middle, 20, 20, 100, 255, 100);
  draw(images[4], 20, 20, 100, 255, 101);  // as good as the same, but not its own
  EXPECT_LT((made(images[4].reshape({1, -1})) - made(middle.view({1, -1}))).abs().max().item<float>(), 0.01);
}

// Patches are a way to compute it; what is computed are the convolutions of the paper.
TEST(PolicyNature, AsConvolutionsOneByOne) {
  at::NoGradGuard no_grad;
  for (const int side : {kNatureSide, 43}) {  // 43: the last three pixels are in no window
    const MadeEncoder made(make_nature, side, cnn_config({8}));
    const at::Tensor images = byte_images({3}, side);
    at::Tensor x = images.view({3, side, side, 3}).permute({0, 3, 1, 2}).to(at::kFloat) / 255;
    const int64_t sizes[] = {8, 4, 3}, inputs[] = {3, 32, 64}, strides[] = {4, 2, 1};
    for (int k = 0; k < 3; ++k) {
      const at::Tensor weight = made.parameters[2 * k].view({-1, sizes[k], sizes[k], inputs[k]}).permute({0, 3, 1, 2});
      x = at::relu(at::conv2d(x, weight, made.parameters[2 * k + 1], at::IntArrayRef{strides[k], strides[k]}));
    }
    const at::Tensor features = x.permute({0, 2, 3, 1}).flatten(1);
    const at::Tensor expected = at::relu(at::linear(features, made.parameters[6], made.parameters[7]));
    EXPECT_LT((made(images) - expected).abs().max().item<float>(), 1e-5f * expected.abs().max().item<float>());
    EXPECT_GT(expected.abs().max().item<float>(), 1e-3);
  }
}

TEST(PolicyImpala, ParametersByArithmetic) {
  // 84 -> 42 -> 21 -> 11, 32 channels: 3872 numbers go to 256. A section has one convolution and four more.
  const MadeEncoder made(make_impala, 84, cnn_config({256}));
  const int64_t sections =
      (27 * 16 + 16) + 4 * (144 * 16 + 16) + (144 * 32 + 32) + 4 * (288 * 32 + 32) + 5 * (288 * 32 + 32);
  EXPECT_EQ(made.parameters.size(), sections + 3872 * 256 + 256);
  EXPECT_EQ(made.parameters.size(), 1'089'088);
  EXPECT_EQ(made(byte_images({2}, 84)).sizes(), at::IntArrayRef({2, 256}));
}

TEST(PolicyImpala, WidthAndOddSides) {
  NetworkConfig config = cnn_config({10});
  config.impala_width = 4;
  const MadeEncoder made(make_impala, 21, config);  // 21 -> 11 -> 6 -> 3, 8 channels: 72 numbers
  EXPECT_EQ(made.parameters.size(), (27 * 4 + 4) + 4 * (36 * 4 + 4) + (36 * 8 + 8) + 9 * (72 * 8 + 8) + 72 * 10 + 10);
  EXPECT_EQ(made(byte_images({2}, 21)).sizes(), at::IntArrayRef({2, 10}));
}

TEST(PolicyImages, OfOtherInputsAreRefused) {
  for (EncoderFactory* make : {make_nature, make_impala, make_compact}) {
    ParameterSet parameters;
    const std::string message = input_error_of([&] { make(parameters, "eye", ObservationShape(84), cnn_config({8})); });
    EXPECT_TRUE(contains(message, {"reads images, and its input has none"}));
  }
}

// The first index of an image is x, its second y, its third the channel; a pixel of 255 counts 1.
TEST(PolicyNature, FirstConvolutionByHand) {
  const MadeEncoder made(make_nature, kNatureSide, cnn_config({8}));
  at::NoGradGuard no_grad;
  const at::Tensor& weight = made.parameters[0];  // [32, 8 x 8 x 3]
  for (int k = 1; k < 6; ++k) made.parameters[k].zero_();
  weight.zero_();
  // One pixel's green, at (2, 5) of a window, on channel 0; then straight through to feature 0.
  weight[0][(2 * 8 + 5) * 3 + 1] = 1;
  made.parameters[2].view({64, 4, 4, 32})[0][0][0][0] = 1;
  made.parameters[4].view({64, 3, 3, 64})[0][0][0][0] = 1;
  made.parameters[6].zero_();
  made.parameters[6][0][0] = 1;
  at::Tensor image = at::zeros({1, kNatureSide, kNatureSide, 3}, at::kByte);
  image[0][2][5][1] = 51;
  EXPECT_NEAR(made(image.view({1, -1}))[0][0].item<float>(), 51.0f / 255, 1e-6);
  EXPECT_EQ(made(image.transpose(1, 2).reshape({1, -1}))[0][0].item<float>(), 0);
}

TEST(PolicyImages, BytesAreTheNumbersThatTheyStandFor) {
  at::NoGradGuard no_grad;
  for (EncoderFactory* make : {make_nature, make_impala, make_compact}) {
    const MadeEncoder made(make, 40, cnn_config({32}));
    const at::Tensor bytes = byte_images({3}, 40), expected = made(bytes);
    EXPECT_TRUE(at::equal(made(bytes.to(at::kFloat)), expected));
    EXPECT_GT(expected.abs().max().item<float>(), 1e-3);
    const at::Tensor coarse = made(bytes.to(at::kBFloat16));
    EXPECT_TRUE(at::equal(made(bytes, Rounding::to_bfloat16), coarse));
    ASSERT_EQ(coarse.scalar_type(), at::kBFloat16);
    // 8 bits of mantissa through a dozen layers.
    EXPECT_LT((coarse.to(at::kFloat) - expected).abs().max().item<float>(), 0.05f * expected.abs().max().item<float>());
  }
}

TEST(PolicyImages, PoolingAsLibTorchs) {
  for (const int64_t side : {5, 6, 21}) {
    const at::Tensor x = (at::arange(2 * 3 * side * side) * 73 % 89).to(at::kFloat).view({2, 3, side, side});
    EXPECT_TRUE(at::equal(pool_of_three(x), at::max_pool2d(x, {3, 3}, {2, 2}, {1, 1}))) << side;
    at::NoGradGuard no_grad;
    EXPECT_TRUE(at::equal(pool_of_three(x), at::max_pool2d(x, {3, 3}, {2, 2}, {1, 1}))) << side;
  }
}

// Of pixels that differ, the largest gets all; of nine equal ones the gradient comes to the same in sum.
TEST(PolicyImages, GradientOfPooling) {
  const at::Tensor x = (at::arange(2 * 3 * 49) * 73 % 293).to(at::kFloat).view({2, 3, 7, 7}).requires_grad_();
  pool_of_three(x).square().sum().backward();
  const at::Tensor own = x.grad().clone();
  x.mutable_grad() = at::Tensor();
  at::max_pool2d(x, {3, 3}, {2, 2}, {1, 1}).square().sum().backward();
  EXPECT_TRUE(at::equal(own, x.grad()));
  const at::Tensor flat = at::ones({1, 1, 7, 7}).requires_grad_();
  pool_of_three(flat).sum().backward();
  EXPECT_EQ(flat.grad().sum().item<float>(), 16);  // of 4 x 4 numbers
  EXPECT_GT(flat.grad().min().item<float>(), 0);
}

// Patches are the same bytes on both; products in fp32 differ in the order of sums, those in bfloat16 by 8 bits of
// mantissa through a few layers.
TEST(PolicyImagesGpu, AsOnTheCpu) {
  if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
  at::NoGradGuard no_grad;
  at::globalContext().setAllowTF32CuDNN(false);
  at::globalContext().setAllowTF32CuBLAS(false);
  const at::Device gpu(at::kCUDA, 0);
  for (EncoderFactory* make : {make_nature, make_impala, make_compact}) {
    const MadeEncoder made(make, 44, cnn_config({32}));
    MadeEncoder there(make, 44, cnn_config({32}), gpu);
    there.parameters.values().copy_(made.parameters.values());
    at::Tensor images = byte_images({6}, 44).view({6, 44, 44, 3});
    for (int k = 1; k < 6; ++k) images[k][k * 7][43 - k * 8] = at::tensor({100, 255, 100}, at::kByte);  // the agent
    images = images.view({6, -1});
    const at::Tensor expected = made(images);
    const float largest = expected.abs().max().item<float>();
    const auto off = [&](const at::Tensor& x, Rounding rounding = Rounding::none) {
      return (there(x, rounding).to(at::kFloat).cpu() - expected).abs().max().item<float>() / largest;
    };
    EXPECT_LT(off(images.to(gpu)), 1e-4f);
    EXPECT_LT(off(images.to(gpu).to(at::kFloat)), 1e-4f);
    EXPECT_LT(off(images.to(gpu).to(at::kBFloat16)), 0.05f);
    EXPECT_LT(off(images.to(gpu), Rounding::to_bfloat16), 0.05f);  // where there are kernels, by these
  }
}

TEST(PolicyImages, GradientsReachEveryParameter) {
  for (EncoderFactory* make : {make_nature, make_impala, make_compact}) {
    const MadeEncoder made(make, 40, cnn_config({32}));
    made(byte_images({4}, 40)).square().sum().backward();
    const auto all = made.parameters.matrices();
    ASSERT_GT(all.size(), 3u);
    for (const MatrixPlace& place : all)
      EXPECT_GT(
          made.parameters.gradient().narrow(0, place.offset, place.rows * place.columns).abs().max().item<float>(), 0)
          << place.offset;
  }
}

}  // namespace
}  // namespace giga::test
