// The kinds of files that a user writes, and the page that documents all their keys (docs/reference.md).
#pragma once

#include <string>
#include <vector>

#include "config/fields.hpp"

namespace giga {

struct FileKind {
  std::string name;   ///< on the command line: "run", "scenario", "map", "agent_type", "agent_types"
  std::string title;  ///< "run config"
  std::string about;  ///< what such a file is for, in Markdown
  FieldList defaults;
};

/// All kinds; the first is that of a run config.
std::vector<FileKind> file_kinds();

/// The reference of all keys of all kinds, as Markdown.
std::string reference_page();

}  // namespace giga
