// What a YAML file is that was given in the place of another: a config, a scenario, a sweep, a mixed team.
#pragma once

#include <filesystem>
#include <string>

namespace giga {

enum class YamlKind : uint8_t { unknown, config, scenario, sweep, mixed_team };

/// By the keys of its first level; unknown: it cannot be read, or may be anything.
YamlKind kind_of(const std::filesystem::path& file);

/// Why a file in which mistakes were found is not what was asked for, and what takes it; empty: it may be.
std::string not_asked_for(const std::filesystem::path& file, YamlKind asked);

}  // namespace giga
