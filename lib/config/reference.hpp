// Reference of all keys of a config file, as tables in Markdown, from its field list.
#pragma once

#include <string>

#include "config/fields.hpp"

namespace giga {

/// One table for the keys of the struct, then a section for each group, list and table in it: key, type, default, what
/// is allowed, meaning. `heading` stands before the titles of the sections ("###"). `see` says where the keys of a map
/// that somebody else reads are.
std::string reference_tables(const FieldList& defaults, const std::string& heading, const std::string& see = "");

}  // namespace giga
