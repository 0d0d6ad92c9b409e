// The tables of a report: what was run, with which settings, on what.
#pragma once

#include <string>
#include <vector>

#include "config/fields.hpp"
#include "io/json.hpp"
#include "report/curves.hpp"

namespace giga {

/// "A: gamma=0.99".
std::string title_of(const RunGroup& group);

/// What a group is known by, as [name, value] pairs: algorithm, seeds, agent-steps, time, speed, device.
Json run_facts(const RunGroup& group);

// Sections of kind `tables`: a list of {caption, folded, head, rows}.
Json config_section(const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys);
Json runs_section(const std::vector<RunGroup>& groups);
Json machine_section(const std::vector<RunGroup>& groups);

/// Section of kind `commands`: how each run was started.
Json commands_section(const std::vector<RunGroup>& groups);

}  // namespace giga
