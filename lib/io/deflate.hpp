// deflated: bytes as a zlib stream.
#pragma once

#include <string>
#include <string_view>

namespace giga {

/// As small as zlib makes it.
std::string deflated(std::string_view raw);

}  // namespace giga
