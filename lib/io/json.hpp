// Json: a value to be written as JSON, for run.json and every `--json`; objects keep the order of insertion. Files that
// build one include <nlohmann/json.hpp>.
#pragma once

#if __has_include(<nlohmann/json_fwd.hpp>)  // packages before 3.11 may have the one large header alone
#include <nlohmann/json_fwd.hpp>
#else
#include <nlohmann/json.hpp>
#endif
#include <string>

namespace giga {

struct Node;

using Json = nlohmann::ordered_json;

/// Indented by two spaces, arrays of numbers on one line. Numbers read back to the same value, whole ones have no
/// point; NaN and infinity, which JSON does not have, become null. Ends without newline.
std::string json_text(const Json& json);

/// A document that was read as JSON.
Json json_of(const Node& node);

/// Writes to a file, or to the standard output where `destination` is "-".
void write_json(const Json& json, const std::string& destination);

}  // namespace giga
