// Compiled scenarios as bytes, so that a page needs no YAML.
#pragma once

#include <string>
#include <string_view>

#include "sim/spec.hpp"

namespace giga {

/// For read_spec of the same version of this program, on any machine whose numbers begin with the lowest byte.
std::string spec_bytes(const SimSpec& spec);
/// Throws Error where the bytes are of another version.
SimSpec read_spec(std::string_view bytes);

}  // namespace giga
