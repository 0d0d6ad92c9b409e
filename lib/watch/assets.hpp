// The files that the page of replays is made of, inside the program (cmake/Embed.cmake writes the definition).
#pragma once

#include <optional>
#include <string_view>

namespace giga {

/// page.html, page.css, data.js, scene.js, agent.js, pane.js, page.js; nothing for other names.
std::optional<std::string_view> watch_asset(std::string_view name);

}  // namespace giga
