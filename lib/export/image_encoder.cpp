#include "export/image_encoder.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

constexpr int kSections = 3;  // of impala

ConvolutionShape keeping_size(const std::string& name, int input, int output) { return {name, input, output, 3, 1, 1}; }

int side_after(const ConvolutionShape& c, int side) { return (side + 2 * c.padding - c.size) / c.stride + 1; }

class PythonImageWriter final : public ImageWriter {
 public:
  PythonImageWriter(bool torch, std::string indent) : torch_(torch), indent_(std::move(indent)) {}

  std::string convolution(const ConvolutionShape& c, const std::string& x) override {
    const auto tensor = [&](std::string name) {
      if (!torch_) return cat("t[\"", name, "\"]");
      std::replace(name.begin(), name.end(), '.', '_');
      return "self." + name;
    };
    const std::string common = cat(x, ", ", tensor(c.weight()), ", ", tensor(c.bias()), ", ");
    return line(
        torch_ ? cat("torch.conv2d(", common, "[", c.stride, ", ", c.stride, "], [", c.padding, ", ", c.padding, "])")
               : cat("convolution(", common, c.stride, ", ", c.padding, ")"));
  }
  std::string relu(const std::string& x) override {
    return line(torch_ ? cat("torch.relu(", x, ")") : cat("np.maximum(", x, ", 0)"));
  }
  std::string pool(const std::string& x) override {
    return line(torch_ ? cat("torch.max_pool2d(", x, ", [3, 3], [2, 2], [1, 1])") : cat("pool(", x, ")"));
  }
  std::string sum(const std::string& x, const std::string& y) override { return line(cat(x, " + ", y)); }
  std::string line(const std::string& value) {
    const std::string name = cat("v", n_++);
    code_ += cat(indent_, name, " = ", value, "\n");
    return name;
  }

  /// With tensors, what `centred` of example/images.py does with arrays.
  std::string centred(const std::string& image, int side) {
    const int middle = side / 2;
    const auto channel = [&](int k) { return line(cat(image, "[:, :, :, ", k, "]")); };
    const std::string r = channel(0), g = channel(1), b = channel(2);
    const std::string own = line(cat("(", g, " == 255) & (", r, " == ", b, ") & (", r, " > 0) & (", r, " < 255)"));
    const std::string number = line(cat("torch.arange(1, ", side * side + 1, ", device=", image, ".device)"));
    const std::string place = line(cat("(", own, ".flatten(1).long() * ", number, ").amax([1]).unsqueeze(1)"));
    const std::string at = line(cat("torch.where(", place, " > 0, ", place, " - 1, torch.full_like(", place, ", ",
                                    middle * side + middle, "))"));
    const std::string steps = line(cat("torch.arange(", side, ", device=", image, ".device)"));
    const std::string far = cat(middle, ", ", side - middle);
    const std::string wide = line(cat("torch.constant_pad_nd(", image, ", [0, 0, ", far, ", ", far, "])"));
    const std::string x = line(cat("torch.floor_divide(", at, ", ", side, ") + ", steps));
    const std::string y = line(cat("torch.remainder(", at, ", ", side, ") + ", steps));
    const std::string rows =
        line(cat(wide, ".gather(1, ", x, ".view(-1, ", side, ", 1, 1).expand(-1, -1, ", 2 * side, ", 3))"));
    return line(cat(rows, ".gather(2, ", y, ".view(-1, 1, ", side, ", 1).expand(-1, ", side, ", -1, 3))"));
  }

  const std::string& code() const { return code_; }

 private:
  const bool torch_;
  const std::string indent_;
  std::string code_;
  int n_ = 0;
};

}  // namespace

std::vector<ConvolutionShape> convolutions_of(const ImageEncoderShape& shape) {
  if (shape.kind == EncoderKind::nature)
    return {{"conv_0", kChannels, 32, 8, 4, 0}, {"conv_1", 32, 64, 4, 2, 0}, {"conv_2", 64, 64, 3, 1, 0}};
  if (shape.kind == EncoderKind::compact)
    return {{"conv_0", kChannels, 32, 4, 4, 0}, {"conv_1", 32, 32, 3, 2, 1}, {"conv_2", 32, 32, 3, 2, 1}};
  GIGA_CHECK(shape.kind == EncoderKind::impala, "an encoder without convolutions");
  std::vector<ConvolutionShape> all;
  int from = kChannels;
  for (int k = 0; k < kSections; ++k) {
    const int to = k == 0 ? shape.impala_width : 2 * shape.impala_width;
    const std::string section = cat("section_", k, ".");
    all.push_back(keeping_size(section + "conv", from, to));
    for (const char* part : {"block_0.0", "block_0.1", "block_1.0", "block_1.1"})
      all.push_back(keeping_size(section + part, to, to));
    from = to;
  }
  return all;
}

bool centres_agent(const ImageEncoderShape& shape) { return shape.kind == EncoderKind::compact; }

int convolved_features(const ImageEncoderShape& shape) {
  const std::vector<ConvolutionShape> all = convolutions_of(shape);
  int side = shape.side;
  if (shape.kind != EncoderKind::impala)
    for (const ConvolutionShape& c : all) side = side_after(c, side);
  else
    for (int k = 0; k < kSections; ++k) side = (side - 1) / 2 + 1;
  return all.back().output * side * side;
}

std::string write_convolutions(const ImageEncoderShape& shape, ImageWriter& writer, const std::string& pixels) {
  const std::vector<ConvolutionShape> all = convolutions_of(shape);
  std::string x = pixels;
  if (shape.kind != EncoderKind::impala) {
    for (const ConvolutionShape& c : all) x = writer.relu(writer.convolution(c, x));
    return x;
  }
  for (size_t k = 0; k < all.size(); k += 5) {
    x = writer.pool(writer.convolution(all[k], x));
    for (const size_t block : {k + 1, k + 3}) {
      const std::string inner = writer.relu(writer.convolution(all[block], writer.relu(x)));
      x = writer.sum(x, writer.convolution(all[block + 1], inner));
    }
  }
  return writer.relu(x);
}

std::string python_convolutions(const ImageEncoderShape& shape, const std::string& image, bool torch,
                                const std::string& indent) {
  PythonImageWriter writer(torch, indent);
  std::string seen = image;
  if (centres_agent(shape)) seen = torch ? writer.centred(image, shape.side) : writer.line(cat("centred(", image, ")"));
  const std::string pixels =
      writer.line(torch ? cat(seen, ".float().permute([0, 3, 1, 2]) / 255.0")
                        : cat(seen, ".astype(np.float32).transpose(0, 3, 1, 2) / np.float32(255)"));
  const std::string last = write_convolutions(shape, writer, pixels);
  return cat(writer.code(), indent, "x = ", last,
             torch ? ".permute([0, 2, 3, 1]).flatten(1)\n" : ".transpose(0, 2, 3, 1).reshape(len(image), -1)\n");
}

}  // namespace giga
