// One SHA-256 over all learned state: two runs with the same hash are in the same state.
#pragma once

#include <string>

#include "core/named_array.hpp"

namespace giga {

/// 64 hexadecimal digits, over name, type, shape and bytes of every array in their order.
std::string state_sha256(const NamedArrays& arrays);

}  // namespace giga
