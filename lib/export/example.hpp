// The parts of the Python example, inside the program (cmake/Embed.cmake writes the definition).
#pragma once

#include <optional>
#include <string_view>

namespace giga {

/// safetensors, onnx, torchscript: how a policy of that format is loaded; images: what convolutions are in numpy; act:
/// how a policy is used. Nothing for other names.
std::optional<std::string_view> example_part(std::string_view name);

}  // namespace giga
