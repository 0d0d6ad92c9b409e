// Numbers that tests share.
#pragma once

#include <limits>

namespace giga {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

}  // namespace giga
