// crc32c: the CRC-32 with Castagnoli's polynomial, as TensorBoard's files carry it (zlib's crc32 is another one).
#pragma once

#include <cstdint>
#include <string_view>

namespace giga {

uint32_t crc32c(std::string_view bytes);

}  // namespace giga
