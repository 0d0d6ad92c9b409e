// deflated: bytes as a zlib stream.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace giga {

/// As small as zlib makes it. `ends`: where parts of different kinds end, in ascending order, so that each is packed by
/// codes of its own; zlib alone cuts by the number of bytes.
std::string deflated(std::string_view raw, std::span<const size_t> ends = {});

}  // namespace giga
