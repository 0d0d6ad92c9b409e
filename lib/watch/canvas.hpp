// Canvas: pixels that are drawn on with soft edges, and the files that they become.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace giga {

struct Colour {
  uint8_t red = 0, green = 0, blue = 0;
};
/// "#0072b2".
Colour colour_of(std::string_view hex);

struct Point {
  double x, y;
};

class Canvas {
 public:
  Canvas(int width, int height, Colour ground);

  int width() const { return width_; }
  int height() const { return height_; }
  /// Three bytes a pixel, rows from the top.
  const std::vector<uint8_t>& pixels() const { return pixels_; }

  /// One pixel.
  void set(int x, int y, Colour colour);
  /// A line with round ends.
  void line(Point a, Point b, double width, Colour colour, double opacity = 1);
  /// A line through all points, of one shade where it bends and crosses itself.
  void path(const std::vector<Point>& points, double width, Colour colour, double opacity = 1);
  void disc(Point centre, double radius, Colour colour, double opacity = 1);
  void ring(Point centre, double radius, double width, Colour colour, double opacity = 1);
  /// A convex polygon.
  void polygon(const std::vector<Point>& corners, Colour colour, double opacity = 1);
  void rectangle(Point a, Point b, Colour colour, double opacity = 1);

 private:
  template <class Distance>
  void fill(Point low, Point high, Colour colour, double opacity, const Distance& distance);

  int width_, height_;
  std::vector<uint8_t> pixels_;
};

std::string encode_png(const Canvas& canvas);

/// A GIF that repeats for ever, picture by picture. All have the size of the first.
class Gif {
 public:
  /// `hundredths`: how long each picture is shown.
  Gif(int width, int height, int hundredths);
  void add(const Canvas& picture);
  /// The bytes of the file.
  std::string finish() const { return bytes_ + ';'; }

 private:
  int width_, height_, hundredths_;
  std::string bytes_;
};

}  // namespace giga
