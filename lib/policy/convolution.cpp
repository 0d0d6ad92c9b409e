#include "policy/convolution.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include <cmath>
#include <limits>

#include "core/error.hpp"
#include "math/image_patches.hpp"
#include "policy/image_layer.hpp"
#include "policy/run_elementwise.hpp"

namespace giga {
namespace {

const float kReluGain = std::sqrt(2.0f);  // of the orthogonal initialisation
constexpr double kByteScale = 1.0 / 255;  // pixels in [0, 1]
constexpr int64_t kAtOnce = 8192;         // images, where no gradient is wanted: bounds the memory

/// The numbers of one network: those of a set, or of a member [1, P] of a population of such sets.
class Weights {
 public:
  explicit Weights(const ParameterSet& set, at::Tensor member = {}) : set_(set), member_(std::move(member)) {}

  at::Tensor operator[](int k) const { return member_.defined() ? set_.of_members(member_, k)[0] : set_[k]; }
  /// The same where the others are rounded.
  at::Tensor exact(int k) const { return member_.defined() ? (*this)[k] : set_.exact(k); }
  at::Tensor dense_layer(const DenseLayer& layer, const at::Tensor& x) const {
    return member_.defined() ? dense_members(set_, member_, layer, x.unsqueeze(0), Rounding::none)[0]
                             : dense(set_, layer, x, Rounding::none);
  }

 private:
  const ParameterSet& set_;
  const at::Tensor member_;
};

/// A convolution by the numbers of its parameters. The weight is a matrix [output, size * size * input], in which the
/// channels lie next to each other as those of images do.
struct Convolution {
  int weight = -1, bias = -1;
  int64_t input, output, size, stride, padding;
};

Convolution add_convolution(ParameterSet& parameters, const std::string& name, int64_t input, int64_t output,
                            int64_t size, int64_t stride, int64_t padding) {
  Convolution c{-1, -1, input, output, size, stride, padding};
  c.weight = parameters.add(name + "/weight", {output, size * size * input}, {Init::Kind::orthogonal, kReluGain});
  c.bias = parameters.add(name + "/bias", {output}, {Init::Kind::constant, 0});
  return c;
}

int64_t side_behind(const Convolution& c, int64_t side) { return (side + 2 * c.padding - c.size) / c.stride + 1; }

/// As LibTorch has it: [output, input, size, size].
at::Tensor weight_of(const Convolution& c, const at::Tensor& matrix) {
  return matrix.view({c.output, c.size, c.size, c.input}).permute({0, 3, 1, 2});
}

/// x [R, input, H, W] -> [R, output, H', W'], in the type of x. `scale`: of the pixels; it is cheaper on the weights.
at::Tensor convolved(const Weights& p, const Convolution& c, const at::Tensor& x, double scale = 1) {
  const at::Tensor weight = scale == 1 ? weight_of(c, p[c.weight]) : weight_of(c, p.exact(c.weight)) * scale;
  return at::conv2d(x, weight.to(x.scalar_type()), p[c.bias].to(x.scalar_type()), at::IntArrayRef{c.stride, c.stride},
                    at::IntArrayRef{c.padding, c.padding});
}
/// The same and ReLU.
at::Tensor rectified(const Weights& p, const Convolution& c, const at::Tensor& x) {
  return rectified_convolution(x, weight_of(c, p[c.weight]).to(x.scalar_type()), p[c.bias].to(x.scalar_type()),
                               c.stride, c.padding);
}

template <class T>
at::Tensor patches_of(const at::Tensor& images, int64_t across, bool centred) {
  const int64_t n = images.size(0), side = images.size(1);
  const T* const pixels = static_cast<const T*>(images.const_data_ptr());
  at::Tensor own;
  if (centred) {
    const at::Tensor places = at::empty({n, side}, images.options().dtype(at::kInt));
    run_elementwise(images, OwnPixels<T>{pixels, static_cast<int>(side), places.data_ptr<int32_t>()}, n * side, 64);
    own = places.amax(1);
  }
  using Patches = ImagePatches<T>;
  const auto type = std::is_same_v<T, BFloat16> ? at::kBFloat16 : at::kFloat;
  const at::Tensor patches = at::empty({n, across, across, kPatch * Patches::kNumbers}, images.options().dtype(type));
  run_elementwise(images,
                  Patches{pixels, centred ? own.const_data_ptr<int32_t>() : nullptr, static_cast<int>(side),
                          static_cast<int>(across), static_cast<typename Patches::Out*>(patches.data_ptr())},
                  n * across * across * kPatch);
  return patches;
}

/// Pixels as bfloat16, where they become that. Else the first layer makes fp32 of bytes.
at::Tensor in_numbers(const at::Tensor& images, Rounding rounding) {
  return rounding == Rounding::to_bfloat16 ? images.to(at::kBFloat16) : images;
}

/// The first layer: a convolution by a stride of kPatch, of a size that is a multiple of it, without padding, and ReLU.
/// Patches are its pixels, because three channels alone fill no tensor core. images [R, side, side, 3] in bytes or
/// numbers. A kernel of its own goes from bytes to bfloat16 in one step, where it serves.
at::Tensor first_layer(const Weights& p, const Convolution& c, const at::Tensor& pixels, bool centred,
                       Rounding rounding) {
  if (rounding == Rounding::to_bfloat16 && image_layer_serves(pixels, p[c.weight], c.size))
    return image_layer(pixels, p.exact(c.weight), p.exact(c.bias), c.size, centred).permute({0, 3, 1, 2});
  const at::Tensor images = in_numbers(pixels, rounding);
  const int64_t across = c.size / kPatch, channels = kPatch * kPatch * c.input;  // of a window, of a patch
  const int64_t patches = side_behind(c, images.size(1)) - 1 + across;
  const at::Tensor x = images.scalar_type() == at::kByte       ? patches_of<uint8_t>(images, patches, centred)
                       : images.scalar_type() == at::kBFloat16 ? patches_of<BFloat16>(images, patches, centred)
                                                               : patches_of<float>(images, patches, centred);
  const at::Tensor weight = p.exact(c.weight)
                                .view({c.output, across, kPatch, across, kPatch * c.input})
                                .transpose(2, 3)
                                .reshape({c.output, across, across, channels}) *
                            kByteScale;
  return at::relu(at::conv2d(x.permute({0, 3, 1, 2}), weight.permute({0, 3, 1, 2}).to(x.scalar_type()),
                             p[c.bias].to(x.scalar_type())));
}

/// What all encoders are: pixels, convolutions, dense layers.
class ImageEncoder : public Encoder {
 public:
  ImageEncoder(const char* kind, const ObservationShape& input) : side_(input.sides[0]) {
    if (input.n_sides != 3 || input.sides[0] != input.sides[1])
      throw InputError(cat("the encoder ", kind, " reads images, and its input has none"));
    channels_ = input.sides[2];
  }

  at::Tensor forward(const ParameterSet& p, at::Tensor x, Rounding rounding) const override {
    return features_of(Weights(p), x, rounding);
  }
  /// One member after the other: a convolution has too much work for a kernel of many small networks.
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x,
                             Rounding rounding) const override {
    std::vector<at::Tensor> features;
    for (int64_t m = 0; m < members.size(0); ++m)
      features.push_back(features_of(Weights(p, members.narrow(0, m, 1)), x[m], rounding));
    return at::stack(features);
  }
  int64_t features() const override { return features_; }

 protected:
  /// images [R, side, side, C] of pixels in [0, 255], bytes or numbers -> [R, output, H, W].
  virtual at::Tensor convolutions(const Weights& p, const at::Tensor& images, Rounding rounding) const = 0;

  void add_dense_layers(ParameterSet& parameters, const std::string& name, int64_t input, const MlpConfig& config) {
    for (const int size : config.hidden) {
      const DenseShape shape{input, size, config.hidden_gain, config.activation, config.layer_norm};
      dense_.push_back(add_dense(parameters, cat(name, "/dense_", dense_.size()), shape));
      input = features_ = size;
    }
  }

  int64_t side_, channels_ = 0;

 private:
  at::Tensor features_of(const Weights& p, const at::Tensor& x, Rounding rounding) const {
    std::vector<int64_t> shape = x.sizes().vec();
    shape.back() = features();
    const at::Tensor images = x.reshape({-1, side_, side_, channels_}).contiguous();
    if (at::GradMode::is_enabled() || images.size(0) <= kAtOnce)
      return features_of_images(p, images, rounding).view(shape);
    std::vector<at::Tensor> parts;
    for (const at::Tensor& part : images.split(kAtOnce)) parts.push_back(features_of_images(p, part, rounding));
    return at::cat(parts).view(shape);
  }
  /// Bytes become numbers here and nowhere before; the channels stay last in memory.
  at::Tensor features_of_images(const Weights& p, const at::Tensor& images, Rounding rounding) const {
    at::Tensor x = convolutions(p, images, rounding).permute({0, 2, 3, 1}).flatten(1);
    for (const DenseLayer& layer : dense_) x = p.dense_layer(layer, x);
    return x;
  }

  int64_t features_ = 0;
  std::vector<DenseLayer> dense_;
};

/// Convolutions one after the other, ReLU behind each; the first of patches.
class Chain final : public ImageEncoder {
 public:
  struct Layer {
    int64_t output, size, stride, padding;
  };

  /// The first layer has a stride of kPatch. `centred`: the agent is moved to the middle of its image.
  Chain(const char* kind, const std::vector<Layer>& layers, bool centred, ParameterSet& parameters,
        const std::string& name, const ObservationShape& input, const NetworkConfig& config)
      : ImageEncoder(kind, input), centred_(centred) {
    int64_t side = side_, from = channels_;
    for (const Layer& l : layers) {
      layers_.push_back(add_convolution(parameters, cat(name, "/conv_", layers_.size()), from, l.output, l.size,
                                        l.stride, l.padding));
      side = side_behind(layers_.back(), side);
      from = l.output;
    }
    add_dense_layers(parameters, name, from * side * side, config);
  }

 private:
  at::Tensor convolutions(const Weights& p, const at::Tensor& images, Rounding rounding) const override {
    at::Tensor x = first_layer(p, layers_[0], images, centred_, rounding);
    for (size_t k = 1; k < layers_.size(); ++k) x = rectified(p, layers_[k], x);
    return x;
  }

  std::vector<Convolution> layers_;
  bool centred_;
};

class Impala final : public ImageEncoder {
 public:
  Impala(ParameterSet& parameters, const std::string& name, const ObservationShape& input, const NetworkConfig& config)
      : ImageEncoder("impala", input) {
    int64_t side = side_, from = channels_;
    for (size_t k = 0; k < sections_.size(); ++k) {
      const int64_t to = k == 0 ? config.impala_width : 2 * config.impala_width;
      const auto same = [&](const std::string& part, int64_t input_channels) {
        return add_convolution(parameters, cat(name, "/section_", k, "/", part), input_channels, to, 3, 1, 1);
      };
      sections_[k] = {
          same("conv", from),
          {{{same("block_0/0", to), same("block_0/1", to)}, {same("block_1/0", to), same("block_1/1", to)}}}};
      side = (side - 1) / 2 + 1;
      from = to;
    }
    add_dense_layers(parameters, name, from * side * side, config);
  }

 private:
  struct Block {
    Convolution first, second;
  };
  struct Section {
    Convolution enter;
    std::array<Block, 2> blocks;
  };

  at::Tensor convolutions(const Weights& p, const at::Tensor& images, Rounding rounding) const override {
    at::Tensor x = in_numbers(images, rounding).permute({0, 3, 1, 2});
    if (x.scalar_type() == at::kByte) x = x.to(at::kFloat);
    for (const Section& section : sections_) {
      x = pool_of_three(convolved(p, section.enter, x, &section == sections_.data() ? kByteScale : 1));
      for (const Block& block : section.blocks)
        x = x + convolved(p, block.second, rectified(p, block.first, at::relu(x)));
    }
    return at::relu(x);
  }

  std::array<Section, 3> sections_;
};

}  // namespace

at::Tensor pool_of_three(const at::Tensor& x) {
  if (!at::GradMode::is_enabled()) return at::max_pool2d(x, {3, 3}, {2, 2}, {1, 1});
  at::Tensor y = at::constant_pad_nd(x, {1, 1, 1, 1}, -std::numeric_limits<double>::infinity());
  for (const int64_t side : {3, 2}) {
    const int64_t end = y.size(side) - 2;  // behind the first pixel of the last three
    const auto every_second = [&](int64_t first) { return y.slice(side, first, first + end, 2); };
    y = at::maximum(at::maximum(every_second(0), every_second(1)), every_second(2));
  }
  return y;
}

std::shared_ptr<const Encoder> make_nature(ParameterSet& parameters, const std::string& name,
                                           const ObservationShape& input, const NetworkConfig& config) {
  if (input.n_sides == 3 && input.sides[0] < kNatureSide)
    throw InputError(cat("the encoder nature needs images of at least ", kNatureSide, " x ", kNatureSide,
                         " pixels; these have ", input.sides[0], " x ", input.sides[0]));
  const std::vector<Chain::Layer> layers = {{32, 8, 4, 0}, {64, 4, 2, 0}, {64, 3, 1, 0}};
  return std::make_shared<Chain>("nature", layers, false, parameters, name, input, config);
}

std::shared_ptr<const Encoder> make_compact(ParameterSet& parameters, const std::string& name,
                                            const ObservationShape& input, const NetworkConfig& config) {
  const std::vector<Chain::Layer> layers = {{32, 4, 4, 0}, {32, 3, 2, 1}, {32, 3, 2, 1}};
  return std::make_shared<Chain>("compact", layers, true, parameters, name, input, config);
}

std::shared_ptr<const Encoder> make_impala(ParameterSet& parameters, const std::string& name,
                                           const ObservationShape& input, const NetworkConfig& config) {
  return std::make_shared<Impala>(parameters, name, input, config);
}

}  // namespace giga
