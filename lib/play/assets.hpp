// The files that the page of play is made of, inside the program (cmake/Embed.cmake writes the definition).
#pragma once

#include <optional>
#include <string_view>

namespace giga {

/// page.html, page.css, module.js, live.js, play.js, and where the build had the compiler for it play.wasm.
std::optional<std::string_view> play_asset(std::string_view name);

}  // namespace giga
