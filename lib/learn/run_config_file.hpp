// A run config as a file: another config that it starts from, and the keys in which it differs.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "config/document.hpp"
#include "learn/run_config.hpp"
#include "scenario/data_dirs.hpp"

namespace giga {

struct RunConfigFile {
  std::optional<std::string> base;
  RunConfig config;
};
template <class V>
void visit_fields(V& v, RunConfigFile& c) {
  v("base", c.base,
    "config to start from: the name of one that comes with gigastep, or a path, from this file's folder; groups are "
    "taken key by key, lists as they are; none = the defaults");
  visit_fields(v, c.config);
}

/// The file with all that it starts from: a document without `base`, whose keys and values stand where they were
/// written. Adds an error where a file cannot be read, is not there, or leads back to itself; the document is then what
/// could be read.
Document read_run_config_file(const std::filesystem::path& file, const DataDirs& dirs, Errors& errors);

}  // namespace giga
