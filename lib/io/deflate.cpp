#include "io/deflate.hpp"

#include <zlib.h>

#include "core/error.hpp"

namespace giga {

std::string deflated(std::string_view raw, std::span<const size_t> ends) {
  constexpr int kWindowBits = 15, kMostMemory = 9;  // zlib's own; the longest blocks
  z_stream stream{};
  GIGA_CHECK(
      deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, kWindowBits, kMostMemory, Z_DEFAULT_STRATEGY) == Z_OK,
      "zlib");
  std::string out;
  const auto pack = [&](size_t first, size_t end, int flush) {
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(raw.data() + first));
    stream.avail_in = static_cast<uInt>(end - first);
    int result = Z_OK;
    do {
      const size_t before = out.size();
      out.resize(before + (size_t{1} << 16));
      stream.next_out = reinterpret_cast<Bytef*>(out.data() + before);
      stream.avail_out = static_cast<uInt>(out.size() - before);
      result = deflate(&stream, flush);
      out.resize(out.size() - stream.avail_out);
    } while (stream.avail_out == 0);
    return result;
  };
  size_t first = 0;
  bool sound = true;
  for (const size_t end : ends) {
    if (end > first) sound = pack(first, end, Z_BLOCK) == Z_OK && sound;
    first = end;
  }
  sound = pack(first, raw.size(), Z_FINISH) == Z_STREAM_END && sound;
  deflateEnd(&stream);
  GIGA_CHECK(sound, "zlib");
  return out;
}

}  // namespace giga
