// What this program is and where it runs: version, and the facts that run.json and benchmark results carry.
#pragma once

#include <string>

#include "core/memory.hpp"
#include "core/shell_word.hpp"
#include "io/json.hpp"

namespace giga {

/// "0.1.0 (commit 0123456789ab, clean tree, build 0123456789ab)".
std::string program_version();

/// The commit that this program was built from: "0123456789ab", "...-dirty" where its sources were changed since,
/// "unknown" where the build could not tell. Written at each build by cmake/Commit.cmake.
const char* program_commit();

/// How to call this very program in a shell: "gigastep", or its path where it was called by path.
std::string program_command();

/// Versions of gigastep and of what it is built from.
Json version_info();

/// CPU, memory, system, and the GPU where the device is one.
Json hardware_info(Device device);

/// The arguments of this process.
Json command_line();

}  // namespace giga
