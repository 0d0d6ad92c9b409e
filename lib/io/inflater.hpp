// Inflater: a zlib stream that is read piece by piece, so that a small file cannot ask for all memory.
#pragma once

#include <zlib.h>

#include <string>
#include <string_view>

namespace giga {

class Inflater {
 public:
  /// `name` is for messages; both must outlive it.
  Inflater(std::string_view bytes, const std::string& name);
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
  ~Inflater();

  /// The next `size` bytes, claimed as they come. Throws InputError where there are fewer, or where they do not unpack.
  std::string take(size_t size);
  /// Nothing may be left, and the checksum at the end must be right: else throws InputError.
  void finish();

 private:
  void step();
  [[noreturn]] void fail(const char* what) const;

  z_stream stream_{};
  const std::string& name_;
  bool ended_ = false;
};

}  // namespace giga
