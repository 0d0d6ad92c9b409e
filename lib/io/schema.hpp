// JSON schema of a config file, from its field list: editors complete and check with it while the file is written.
#pragma once

#include <string>

#include "config/fields.hpp"
#include "io/json.hpp"

namespace giga {

/// Draft 7, which the YAML language server and most editors read. Every key has its documentation, default, type and
/// limits; other keys are refused. What only a whole file tells (names of types and maps, a batch that does not divide)
/// is left to the program. `defaults`: the fields of a struct of defaults.
Json json_schema(const FieldList& defaults, const std::string& title);

}  // namespace giga
