// The sections of a report, as HTML.
#pragma once

#include <string>
#include <vector>

#include "config/fields.hpp"
#include "io/json.hpp"
#include "report/curves.hpp"

namespace giga {

/// All sections in the order of the page; `keys` are the keys of a run config with their defaults. To add a section: a
/// function that writes it, a line in page_sections().
std::string page_sections(const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys);

/// Where the points of each group are along the axes, for the page's script.
Json group_axes(const std::vector<RunGroup>& groups);

}  // namespace giga
