// kernel_source(): the headers that the step is made of, inside the program, for the compiler at run time.
#pragma once

#include <optional>
#include <string_view>

namespace giga {

/// The text of a header, by the name under which it is included; under "names" those names, each in a line. The list
/// stands in cuda/CMakeLists.txt.
std::optional<std::string_view> kernel_source(std::string_view name);

}  // namespace giga
