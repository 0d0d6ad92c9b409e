// What the tests of stopping and resuming share: a tiny run, its hash, and its figures without the times.
#pragma once

#include <string>

#include "program.hpp"

namespace giga::test {

/// One against one, 16 worlds, 4 updates of 256 agent-steps; evaluated after updates 2 and 4, saved after each.
extern const char* const kShortConfig;

/// SHA-256 of the state in a checkpoint, or in the newest whole one of a run folder, as `gigastep inspect` says it.
std::string state_hash(const Workplace& here, const std::string& checkpoint);

/// All columns of metrics.csv but the times and speeds, which no two runs share.
std::string timeless_metrics(const Workplace& here, const std::string& run);

/// The first line that differs; empty where none does.
std::string metrics_difference(const std::string& a, const std::string& b);

/// Rows of metrics.csv so far; 0 where it is not there yet.
size_t metrics_rows(const Workplace& here, const std::string& run);
/// Of these, with a number in a column.
size_t rows_of_column(const Workplace& here, const std::string& run, const std::string& column);

}  // namespace giga::test
