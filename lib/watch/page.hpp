// The page that plays replays: one file that holds its games and all that shows them, and asks nothing of the network.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace giga {

/// `replays`: files as encode_replay makes them, at least one. Where there are several, the first games of the first
/// two are shown side by side. `version`: of the program.
std::string watch_page(const std::vector<std::string>& replays, const std::string& title, const std::string& version);

/// Bytes as letters that any page can hold.
std::string base64(std::string_view bytes);

}  // namespace giga
