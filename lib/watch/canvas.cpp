#include "watch/canvas.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/error.hpp"
#include "io/deflate.hpp"

namespace giga {
namespace {

void put_big_endian(std::string& out, uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(value >> shift & 255);
}
void put_little_endian(std::string& out, int value) {
  out += static_cast<char>(value & 255);
  out += static_cast<char>(value >> 8 & 255);
}

void put_chunk(std::string& out, std::string_view type, const std::string& data) {
  put_big_endian(out, static_cast<uint32_t>(data.size()));
  const std::string body = std::string(type) + data;
  out += body;
  put_big_endian(out, static_cast<uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(body.data()), body.size())));
}

/// The colours of a GIF: 6 shades each of red, green and blue, then 40 greys.
constexpr int kShades = 6, kGreys = 40, kCube = kShades * kShades * kShades;
int nearest_of(int value, int count) { return (value * (count - 1) + 127) / 255; }
Colour gif_colour(int k) {
  const auto level = [](int at, int count) { return static_cast<uint8_t>(at * 255 / (count - 1)); };
  if (k >= kCube) return {level(k - kCube, kGreys), level(k - kCube, kGreys), level(k - kCube, kGreys)};
  return {level(k / (kShades * kShades), kShades), level(k / kShades % kShades, kShades), level(k % kShades, kShades)};
}
uint8_t gif_number(Colour c) {
  const auto distance = [c](int k) {
    const Colour other = gif_colour(k);
    const int red = c.red - other.red, green = c.green - other.green, blue = c.blue - other.blue;
    return red * red + green * green + blue * blue;
  };
  const int cube =
      (nearest_of(c.red, kShades) * kShades + nearest_of(c.green, kShades)) * kShades + nearest_of(c.blue, kShades);
  const int grey = kCube + nearest_of((c.red + c.green + c.blue) / 3, kGreys);
  return static_cast<uint8_t>(distance(grey) < distance(cube) ? grey : cube);
}

/// Codes of 9 to 12 bits, the lowest bit first, in blocks of at most 255 bytes.
class GifCodes {
 public:
  explicit GifCodes(std::string& out) : out_(out) {}
  void put(int code, int bits) {
    held_ |= static_cast<uint32_t>(code) << count_;
    for (count_ += bits; count_ >= 8; count_ -= 8, held_ >>= 8) put_byte(static_cast<char>(held_ & 255));
  }
  void finish() {
    if (count_ > 0) put_byte(static_cast<char>(held_ & 255));
    flush();
    out_ += '\0';
  }

 private:
  void put_byte(char byte) {
    block_ += byte;
    if (block_.size() == 255) flush();
  }
  void flush() {
    if (block_.empty()) return;
    out_ += static_cast<char>(block_.size());
    out_ += block_;
    block_.clear();
  }
  std::string& out_;
  std::string block_;
  uint32_t held_ = 0;
  int count_ = 0;
};

/// LZW as GIF89a, appendix F, has it.
void put_lzw(std::string& out, const std::vector<uint8_t>& pixels) {
  constexpr int kClear = 256, kEnd = 257, kMost = 4096;
  out += '\x08';
  GifCodes codes(out);
  std::vector<int16_t> next(static_cast<size_t>(kMost) * 256, -1);  // [code, byte behind it]
  int known = kEnd + 1, bits = 9, word = -1;
  codes.put(kClear, bits);
  for (const uint8_t pixel : pixels) {
    if (word < 0) {
      word = pixel;
      continue;
    }
    int16_t& longer = next[static_cast<size_t>(word) * 256 + pixel];
    if (longer >= 0) {
      word = longer;
      continue;
    }
    codes.put(word, bits);
    word = pixel;
    if (known == kMost) {
      codes.put(kClear, bits);
      std::fill(next.begin(), next.end(), int16_t{-1});
      known = kEnd + 1;
      bits = 9;
      continue;
    }
    if (known == 1 << bits && bits < 12) ++bits;
    longer = static_cast<int16_t>(known++);
  }
  if (word >= 0) codes.put(word, bits);
  if (known == 1 << bits && bits < 12) ++bits;
  codes.put(kEnd, bits);
  codes.finish();
}

}  // namespace

Colour colour_of(std::string_view hex) {
  GIGA_CHECK(hex.size() == 7 && hex[0] == '#', "colour ", hex);
  const auto byte = [&](size_t at) {
    return static_cast<uint8_t>(std::stoi(std::string(hex.substr(at, 2)), nullptr, 16));
  };
  return {byte(1), byte(3), byte(5)};
}

Canvas::Canvas(int width, int height, Colour ground)
    : width_(width), height_(height), pixels_(static_cast<size_t>(width) * static_cast<size_t>(height) * 3) {
  for (size_t at = 0; at < pixels_.size(); at += 3) {
    pixels_[at] = ground.red;
    pixels_[at + 1] = ground.green;
    pixels_[at + 2] = ground.blue;
  }
}

void Canvas::set(int x, int y, Colour colour) {
  GIGA_CHECK(x >= 0 && x < width_ && y >= 0 && y < height_, "pixel ", x, ", ", y, " of ", width_, " x ", height_);
  uint8_t* pixel = pixels_.data() + (static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)) * 3;
  pixel[0] = colour.red;
  pixel[1] = colour.green;
  pixel[2] = colour.blue;
}

/// Mixes a colour into the pixels whose distance to a shape is less than half a pixel; inside it is negative.
template <class Distance>
void Canvas::fill(Point low, Point high, Colour colour, double opacity, const Distance& distance) {
  const auto from = [](double at) { return std::max(0, static_cast<int>(std::floor(at - 1))); };
  const auto to = [](double at, int size) { return std::min(size, static_cast<int>(std::ceil(at + 1))); };
  for (int y = from(low.y); y < to(high.y, height_); ++y) {
    for (int x = from(low.x); x < to(high.x, width_); ++x) {
      const double cover = opacity * std::clamp(0.5 - distance(Point{x + 0.5, y + 0.5}), 0.0, 1.0);
      if (cover <= 0) continue;
      uint8_t* pixel = &pixels_[(static_cast<size_t>(y) * static_cast<size_t>(width_) + static_cast<size_t>(x)) * 3];
      const uint8_t mixed[3] = {colour.red, colour.green, colour.blue};
      for (int k = 0; k < 3; ++k)
        pixel[k] = static_cast<uint8_t>(std::lround(pixel[k] + cover * (mixed[k] - pixel[k])));
    }
  }
}

/// From p to the line from a to b.
static double way_to_line(Point p, Point a, Point b) {
  const double dx = b.x - a.x, dy = b.y - a.y, length2 = dx * dx + dy * dy;
  const double along = length2 > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / length2, 0.0, 1.0) : 0.0;
  return std::hypot(p.x - a.x - along * dx, p.y - a.y - along * dy);
}

void Canvas::line(Point a, Point b, double width, Colour colour, double opacity) {
  const double r = width / 2;
  fill({std::min(a.x, b.x) - r, std::min(a.y, b.y) - r}, {std::max(a.x, b.x) + r, std::max(a.y, b.y) + r}, colour,
       opacity, [&](Point p) { return way_to_line(p, a, b) - r; });
}

void Canvas::path(const std::vector<Point>& points, double width, Colour colour, double opacity) {
  GIGA_CHECK(!points.empty(), "a path without points");
  Point low = points[0], high = points[0];
  for (const Point& p : points) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y)};
  }
  // The way from each pixel to the nearest of the lines, as far as it matters.
  const double r = width / 2, reach = r + 2;
  const int left = static_cast<int>(std::floor(low.x - reach)), top = static_cast<int>(std::floor(low.y - reach));
  const int columns = static_cast<int>(std::ceil(high.x + reach)) - left + 1;
  const int rows = static_cast<int>(std::ceil(high.y + reach)) - top + 1;
  std::vector<float> way(static_cast<size_t>(columns) * static_cast<size_t>(rows), static_cast<float>(reach));
  const auto at = [&](int x, int y) -> float& {
    return way[static_cast<size_t>(y - top) * static_cast<size_t>(columns) + static_cast<size_t>(x - left)];
  };
  for (size_t k = 0; k < points.size(); ++k) {
    const Point a = points[k], b = points[std::min(k + 1, points.size() - 1)];
    const auto from = [&](double u, double v) { return static_cast<int>(std::floor(std::min(u, v) - r - 1)); };
    const auto to = [&](double u, double v) { return static_cast<int>(std::ceil(std::max(u, v) + r + 1)); };
    for (int y = from(a.y, b.y); y < to(a.y, b.y); ++y)
      for (int x = from(a.x, b.x); x < to(a.x, b.x); ++x)
        at(x, y) = std::min(at(x, y), static_cast<float>(way_to_line({x + 0.5, y + 0.5}, a, b)));
  }
  fill({low.x - r, low.y - r}, {high.x + r, high.y + r}, colour, opacity, [&](Point p) {
    return static_cast<double>(at(static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y)))) - r;
  });
}

void Canvas::disc(Point centre, double radius, Colour colour, double opacity) {
  line(centre, centre, 2 * radius, colour, opacity);
}

void Canvas::ring(Point centre, double radius, double width, Colour colour, double opacity) {
  const double outer = radius + width / 2;
  fill({centre.x - outer, centre.y - outer}, {centre.x + outer, centre.y + outer}, colour, opacity,
       [&](Point p) { return std::abs(std::hypot(p.x - centre.x, p.y - centre.y) - radius) - width / 2; });
}

void Canvas::polygon(const std::vector<Point>& corners, Colour colour, double opacity) {
  GIGA_CHECK(corners.size() >= 3, corners.size(), " corners");
  Point low = corners[0], high = corners[0];
  double area = 0;
  for (size_t k = 0; k < corners.size(); ++k) {
    const Point &a = corners[k], &b = corners[(k + 1) % corners.size()];
    low = {std::min(low.x, a.x), std::min(low.y, a.y)};
    high = {std::max(high.x, a.x), std::max(high.y, a.y)};
    area += a.x * b.y - b.x * a.y;
  }
  const double side = area > 0 ? 1 : -1;
  fill(low, high, colour, opacity, [&](Point p) {
    double outside = -1e9;
    for (size_t k = 0; k < corners.size(); ++k) {
      const Point &a = corners[k], &b = corners[(k + 1) % corners.size()];
      const double length = std::hypot(b.x - a.x, b.y - a.y);
      if (length > 0)
        outside = std::max(outside, side * ((p.x - a.x) * (b.y - a.y) - (p.y - a.y) * (b.x - a.x)) / length);
    }
    return outside;
  });
}

void Canvas::rectangle(Point a, Point b, Colour colour, double opacity) {
  polygon({a, {b.x, a.y}, b, {a.x, b.y}}, colour, opacity);
}

std::string encode_png(const Canvas& canvas) {
  const auto row = static_cast<size_t>(canvas.width()) * 3;
  std::string raw;
  for (size_t at = 0; at < canvas.pixels().size(); at += row) {
    raw += '\0';  // no filter
    raw.append(canvas.pixels().begin() + static_cast<std::ptrdiff_t>(at),
               canvas.pixels().begin() + static_cast<std::ptrdiff_t>(at + row));
  }
  std::string header;
  put_big_endian(header, static_cast<uint32_t>(canvas.width()));
  put_big_endian(header, static_cast<uint32_t>(canvas.height()));
  header += std::string("\x08\x02\x00\x00\x00", 5);  // 8 bits, red green blue
  std::string out = "\x89PNG\r\n\x1a\n";
  put_chunk(out, "IHDR", header);
  put_chunk(out, "IDAT", deflated(raw));
  put_chunk(out, "IEND", "");
  return out;
}

Gif::Gif(int width, int height, int hundredths) : width_(width), height_(height), hundredths_(hundredths) {
  bytes_ = "GIF89a";
  put_little_endian(bytes_, width);
  put_little_endian(bytes_, height);
  bytes_ += std::string("\xF7\x00\x00", 3);  // 256 colours
  static_assert(kCube + kGreys == 256);
  for (int k = 0; k < 256; ++k) {
    const Colour colour = gif_colour(k);
    for (const uint8_t part : {colour.red, colour.green, colour.blue}) bytes_ += static_cast<char>(part);
  }
  bytes_ += std::string("\x21\xFF\x0BNETSCAPE2.0\x03\x01\x00\x00\x00", 19);  // for ever
}

void Gif::add(const Canvas& picture) {
  GIGA_CHECK(picture.width() == width_ && picture.height() == height_, "a picture of another size");
  bytes_ += std::string("\x21\xF9\x04\x00", 4);
  put_little_endian(bytes_, hundredths_);
  bytes_ += std::string("\x00\x00", 2);
  bytes_ += ',';
  for (const int value : {0, 0, width_, height_}) put_little_endian(bytes_, value);
  bytes_ += '\0';
  std::vector<uint8_t> numbers;
  const std::vector<uint8_t>& p = picture.pixels();
  for (size_t at = 0; at < p.size(); at += 3) numbers.push_back(gif_number({p[at], p[at + 1], p[at + 2]}));
  put_lzw(bytes_, numbers);
}

}  // namespace giga
