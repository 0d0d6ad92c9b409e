// What commands that play matches tell of how these are played.
#pragma once

#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <utility>

namespace giga {

/// For MatchOptions::note: each text on the standard error, but not again where all matches say the same.
inline std::function<void(const std::string&)> note_once() {
  return [told = std::make_shared<std::string>()](const std::string& text) {  // shared by copies of the options
    if (std::exchange(*told, text) != text) std::cerr << "note: " << text << '\n';
  };
}

}  // namespace giga
