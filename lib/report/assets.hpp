// The files that a page is made of, inside the program (cmake/Embed.cmake writes the definition).
#pragma once

#include <optional>
#include <string_view>

namespace giga {

/// page.html, page.css, chart.js, page.js; nothing for other names.
std::optional<std::string_view> report_asset(std::string_view name);

}  // namespace giga
