// The encoders of images as every format writes them: which convolutions there are, and in what order they come.
#pragma once

#include <string>
#include <vector>

#include "policy/config.hpp"

namespace giga {

/// What makes an encoder of images, beside the dense layers behind it.
struct ImageEncoderShape {
  EncoderKind kind = EncoderKind::mlp;
  int side = 0;          ///< pixels of the image
  int impala_width = 0;  ///< of EncoderKind::impala

  bool operator==(const ImageEncoderShape&) const = default;
};

/// A convolution on squares of size x size pixels. Its tensors are NAME.weight [output, input, size, size], where the
/// first side is along x, and NAME.bias [output].
struct ConvolutionShape {
  std::string name;
  int input, output, size, stride, padding;

  std::string weight() const { return name + ".weight"; }
  std::string bias() const { return name + ".bias"; }
};

/// In the order in which they are computed.
std::vector<ConvolutionShape> convolutions_of(const ImageEncoderShape& shape);
/// Numbers that come out of the last one, channels last: what the first dense layer takes.
int convolved_features(const ImageEncoderShape& shape);

/// Writes the steps of an encoder in some language; values are known by their names. Images are [B, C, x, y].
class ImageWriter {
 public:
  virtual ~ImageWriter() = default;
  virtual std::string convolution(const ConvolutionShape& shape, const std::string& x) = 0;
  virtual std::string relu(const std::string& x) = 0;
  /// The largest of 3 x 3 at every second pixel, with a padding of 1.
  virtual std::string pool(const std::string& x) = 0;
  virtual std::string sum(const std::string& x, const std::string& y) = 0;

 protected:
  ImageWriter() = default;
  ImageWriter(const ImageWriter&) = default;
  ImageWriter& operator=(const ImageWriter&) = default;
};

/// Whether the encoder first moves the agent to the middle of its image (math/image_patches.hpp).
bool centres_agent(const ImageEncoderShape& shape);
/// From pixels in [0, 1] to the last convolution's numbers [B, C, x, y].
std::string write_convolutions(const ImageEncoderShape& shape, ImageWriter& writer, const std::string& pixels);

/// The lines of Python that do so from `image`, [B, side, side, 3] of bytes, to x [B, features]. `torch`: with tensors
/// `self.NAME`; else with numpy, functions `convolution`, `pool` and `centred`, and tensors `t["NAME"]`.
std::string python_convolutions(const ImageEncoderShape& shape, const std::string& image, bool torch,
                                const std::string& indent);

}  // namespace giga
