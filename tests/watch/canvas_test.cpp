// Pixels, and the files that they become.
#include "watch/canvas.hpp"

#include <gtest/gtest.h>
#include <zlib.h>

#include "io/sample_replay.hpp"
#include "watch/film.hpp"
#include "watch/trajectories.hpp"

namespace giga::test {
namespace {

std::string pixel(const Canvas& canvas, int x, int y) {
  const uint8_t* p = &canvas.pixels()[static_cast<size_t>(3 * (y * canvas.width() + x))];
  return std::to_string(p[0]) + " " + std::to_string(p[1]) + " " + std::to_string(p[2]);
}

TEST(Canvas, ShapesCoverWhatTheyShould) {
  Canvas canvas(20, 10, colour_of("#ffffff"));
  canvas.rectangle({2, 2}, {8, 8}, colour_of("#0072b2"));
  EXPECT_EQ(pixel(canvas, 2, 2), "0 114 178");
  EXPECT_EQ(pixel(canvas, 7, 7), "0 114 178");
  EXPECT_EQ(pixel(canvas, 8, 5), "255 255 255");
  EXPECT_EQ(pixel(canvas, 1, 5), "255 255 255");
  canvas.disc({14.5, 4.5}, 3, colour_of("#000000"), 0.5);
  EXPECT_EQ(pixel(canvas, 14, 4), "128 128 128") << "half of white";  // 255 - 0.5 x 255 = 127.5
  EXPECT_EQ(pixel(canvas, 18, 4), "255 255 255") << "3.5 from the middle: none of it is covered";
  canvas.line({0.5, 9.5}, {19.5, 9.5}, 1, colour_of("#d55e00"));
  EXPECT_EQ(pixel(canvas, 10, 9), "213 94 0");
}

TEST(Canvas, PngUnpacksToItsPixels) {
  Canvas canvas(3, 2, colour_of("#102030"));
  canvas.rectangle({0, 0}, {1, 1}, colour_of("#ff0000"));
  const std::string png = encode_png(canvas);
  const size_t at = png.find("IDAT") + 4;
  uLongf size = 2 * (1 + 3 * 3);
  std::string raw(size, '\0');
  ASSERT_EQ(uncompress(reinterpret_cast<Bytef*>(raw.data()), &size, reinterpret_cast<const Bytef*>(png.data() + at),
                       png.size() - at),
            Z_OK);
  EXPECT_EQ(raw.substr(0, 7), std::string("\0\xFF\0\0\x10\x20\x30", 7));
  EXPECT_EQ(raw[10], '\0') << "no filter in the second row either";
}

/// The numbers of the first picture of a GIF, as GIF89a says they are unpacked.
std::vector<int> unpacked(const std::string& gif) {
  size_t at = 13 + 3 * 256 + 19 + 8 + 10;  // header, colours, repetition, timing, place of the picture
  EXPECT_EQ(gif[at], 8);
  std::string data;
  for (++at; gif[at]; at += static_cast<unsigned char>(gif[at]) + 1u)
    data += gif.substr(at + 1, static_cast<unsigned char>(gif[at]));
  std::vector<std::vector<int>> words;
  std::vector<int> out, last;
  int bits = 9;
  size_t from = 0;
  const auto clear = [&] {
    words.clear();
    for (int k = 0; k < 258; ++k) words.push_back({k});
    bits = 9;
    last.clear();
  };
  clear();
  while (true) {
    int code = 0;
    for (int b = 0; b < bits; ++b, ++from)
      code |= (static_cast<unsigned char>(data.at(from / 8)) >> (from % 8) & 1) << b;
    if (code == 256) {
      clear();
      continue;
    }
    if (code == 257) return out;
    std::vector<int> word = static_cast<size_t>(code) < words.size() ? words[static_cast<size_t>(code)] : last;
    if (static_cast<size_t>(code) >= words.size()) word.push_back(last.at(0));
    out.insert(out.end(), word.begin(), word.end());
    if (!last.empty() && words.size() < 4096) {
      last.push_back(word[0]);
      words.push_back(last);
    }
    if (words.size() == 1u << bits && bits < 12) ++bits;
    last = word;
  }
}

TEST(Canvas, GifUnpacksToItsPixels) {
  // Noise of many colours, so that the table of words fills up and begins anew.
  Canvas canvas(160, 120, colour_of("#ffffff"));
  uint32_t random = 1;
  std::vector<int> shades;
  for (int y = 0; y < 120; ++y)
    for (int x = 0; x < 160; ++x) {
      random = random * 1664525u + 1013904223u;
      const int k = static_cast<int>(random >> 24) % 6;  // 6 greys of the cube
      const auto level = static_cast<uint8_t>(51 * k);
      canvas.rectangle({double(x), double(y)}, {x + 1.0, y + 1.0}, {level, level, level});
      shades.push_back(k);
    }
  Gif gif(160, 120, 10);
  gif.add(canvas);
  const std::vector<int> numbers = unpacked(gif.finish());
  ASSERT_EQ(numbers.size(), shades.size());
  for (size_t k = 0; k < numbers.size(); ++k) ASSERT_EQ(numbers[k], 43 * shades[k]) << "36 + 6 + 1 a shade";
}

// A line with a point on it is no darker there, and one that crosses itself is no darker where it does.
TEST(Canvas, APathHasOneShade) {
  Canvas canvas(40, 20, {255, 255, 255});
  canvas.path({{5, 10}, {15, 10}, {25, 10}, {20, 5}, {20, 15}}, 3, {0, 0, 0}, 0.5);
  const std::string shade = pixel(canvas, 10, 10);
  EXPECT_EQ(shade, "128 128 128") << "255 - 0.5 x 255 = 127.5";
  EXPECT_EQ(pixel(canvas, 15, 10), shade) << "a joint";
  EXPECT_EQ(pixel(canvas, 20, 10), shade) << "a crossing";
  EXPECT_EQ(pixel(canvas, 10, 13), "255 255 255");
  canvas.path({{-5, -5}, {45, 25}}, 2, {0, 0, 0}, 1);  // beyond all sides
  canvas.path({{30, 15}}, 4, {0, 0, 0}, 1);
  EXPECT_EQ(pixel(canvas, 30, 15), "0 0 0") << "a point is a dot";
}

TEST(Film, AsManyPicturesAsItSays) {
  const Replay replay = sample_replay();  // four steps
  EXPECT_EQ(film_length(replay, {0, 100, 2}), 3);
  EXPECT_EQ(film_length(replay, {0, 100, 3}), 3) << "states 0, 3 and the last";
  const Canvas first = film_picture(replay, {0, 400, 3}, 0);
  EXPECT_EQ(first.width(), 420);  // ten pixels around
  // Agent 0 is at (1, 1) of 10: 40 from the left, 360 from the top; its colour is that of team 0.
  EXPECT_EQ(pixel(first, 50, 370), "0 114 178");
  EXPECT_NE(pixel(film_picture(replay, {0, 400, 3}, 2), 50, 370), "0 114 178") << "it has flown on";
}

TEST(Trajectories, APathForEachAgent) {
  const std::string svg = trajectories_svg(sample_replay());
  EXPECT_NE(svg.find("&lt;b&gt;circle&lt;/b&gt;"), std::string::npos);
  EXPECT_NE(svg.find("episode 0: team 0 wins after 4 steps"), std::string::npos);
  // Agent 0 from (1, 1) to (1.4, 1), 30 pixels a unit, from the left margin of 20.
  EXPECT_NE(svg.find("M50 "), std::string::npos);
  EXPECT_NE(svg.find("L62 "), std::string::npos);
}

}  // namespace
}  // namespace giga::test
