// The header of a replay: JSON, its checks, and that of crowds, which tells agents in groups.
#pragma once

#include <string>

#include "io/replay.hpp"

namespace giga {

constexpr size_t kMostReplayBytes = size_t{1} << 30;  ///< of all columns

/// What is wrong with numbers of the header that the columns, or a reader, rely on; empty: nothing.
std::string broken_header(const Replay& replay);
std::string header_text(const Replay& replay);
/// A replay without columns. Throws InputError; `name` is for messages.
Replay read_header(const std::string& json, const std::string& name, int format);

}  // namespace giga
