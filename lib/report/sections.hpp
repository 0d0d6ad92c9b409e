// The sections of a report, as the JSON that the page draws.
#pragma once

#include <vector>

#include "config/fields.hpp"
#include "io/json.hpp"
#include "report/curves.hpp"

namespace giga {

/// Every section has a `kind`, which sections.js knows how to draw, and a `title`; what else it has is the kind's. All
/// sections in the order of the page; `keys` are the keys of a run config with their defaults. To add a section: a
/// function here, a kind in sections.js if none fits.
Json report_sections(const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys);

/// The groups: how their curves are to be read, and the x of their points.
Json report_groups(const std::vector<RunGroup>& groups);

}  // namespace giga
