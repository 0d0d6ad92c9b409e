// Pages from a template.
#pragma once

#include <map>
#include <string>
#include <string_view>

namespace giga {

/// Puts texts in the places {{name}} of a template; what is put in is not looked at again. Throws Error where a place
/// has no text.
std::string fill_template(std::string_view page, const std::map<std::string, std::string>& texts);

}  // namespace giga
