#include "io/deflate.hpp"

#include <zlib.h>

#include "core/error.hpp"

namespace giga {

std::string deflated(std::string_view raw) {
  uLongf size = compressBound(static_cast<uLong>(raw.size()));
  std::string out(size, '\0');
  const int result = compress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(raw.data()),
                               static_cast<uLong>(raw.size()), Z_BEST_COMPRESSION);
  GIGA_CHECK(result == Z_OK, "zlib: ", result);
  out.resize(size);
  return out;
}

}  // namespace giga
