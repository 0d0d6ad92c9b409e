#include "io/inflater.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga {

Inflater::Inflater(std::string_view bytes, const std::string& name) : name_(name) {
  stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream_.avail_in = static_cast<uInt>(bytes.size());
  GIGA_CHECK(inflateInit(&stream_) == Z_OK, "zlib");
}

Inflater::~Inflater() { inflateEnd(&stream_); }

std::string Inflater::take(size_t size) {
  std::string out;
  while (out.size() < size) {
    const size_t before = out.size(), piece = std::min(size - before, size_t{1} << 20);
    out.resize(before + piece);
    stream_.next_out = reinterpret_cast<Bytef*>(out.data() + before);
    stream_.avail_out = static_cast<uInt>(piece);
    while (stream_.avail_out > 0) step();
  }
  return out;
}

void Inflater::finish() {
  char one = 0;
  stream_.next_out = reinterpret_cast<Bytef*>(&one);
  stream_.avail_out = 1;
  while (!ended_) {
    step();
    if (stream_.avail_out == 0) fail("is damaged: it holds more than it says");
  }
  if (stream_.avail_in > 0) fail("is damaged: something follows its end");
}

void Inflater::step() {
  if (ended_) fail("is damaged: it holds less than it says");
  const int result = inflate(&stream_, Z_NO_FLUSH);
  if (result == Z_STREAM_END)
    ended_ = true;
  else if (result == Z_BUF_ERROR && stream_.avail_in == 0)
    fail("is truncated");
  else if (result != Z_OK)
    fail("is damaged: its bytes do not unpack");
}

void Inflater::fail(const char* what) const { throw InputError(cat(name_, " ", what)); }

}  // namespace giga
