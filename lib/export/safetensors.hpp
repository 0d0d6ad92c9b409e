// safetensors: named arrays in one file of a header and plain bytes; nothing in it is ever executed.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/named_array.hpp"

namespace giga {

/// The format: the header's length (8 bytes, little-endian), the header in JSON, which names type, shape and place of
/// each tensor, then the tensors' bytes. `metadata` is kept as `__metadata__`.
std::string encode_safetensors(const NamedArrays& tensors,
                               const std::vector<std::pair<std::string, std::string>>& metadata);

/// The tensors in the order of their bytes. Throws InputError with `name` (the file) and what is wrong: a length beyond
/// the file, a header that is no JSON object or names something twice, an unknown type, a shape that does not fit its
/// place, bytes that belong to two tensors or to none. No more is allocated than the file has bytes.
NamedArrays decode_safetensors(std::string_view bytes, const std::string& name);

}  // namespace giga
