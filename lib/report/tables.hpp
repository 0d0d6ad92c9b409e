// The tables of a report: what was run, with which settings, on what.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "chart/markup.hpp"
#include "config/fields.hpp"
#include "report/curves.hpp"

namespace giga {

using TableRow = std::vector<std::string>;

/// A table with an optional caption; `folded`: opened by the reader.
void write_table(Markup& page, const std::string& caption, const TableRow& head, const std::vector<TableRow>& rows,
                 bool folded = false);

/// "A: gamma=0.99".
std::string title_of(const RunGroup& group);

/// What a group is known by, as names and values: algorithm, seeds, agent-steps, time, speed, device.
std::vector<std::pair<std::string, std::string>> run_facts(const RunGroup& group);

// What stands in the sections of these names.
void write_config(Markup& page, const std::vector<RunGroup>& groups, const std::vector<FieldInfo>& keys);
void write_runs(Markup& page, const std::vector<RunGroup>& groups);
void write_machines(Markup& page, const std::vector<RunGroup>& groups);
void write_commands(Markup& page, const std::vector<RunGroup>& groups);

}  // namespace giga
