// Reports: one page with the learning curves, figures and settings of one or several runs. It holds its data and all
// that draws them, and asks nothing of the network.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "config/fields.hpp"
#include "report/run_data.hpp"

namespace giga {

/// The page of some runs (at least one). Runs that differ only in their seed become one curve. `keys` are the keys of a
/// run config (`list_fields<RunConfig>()`): what is not the default is shown first. `first_section`: HTML that stands
/// before all else.
std::string report_page(const std::vector<RunData>& runs, const std::vector<FieldInfo>& keys,
                        const std::string& first_section = "");

/// Reads run folders and writes their page. Of several, those that cannot be reported are left out; returned is why, a
/// line each. Throws InputError where no run is left, and for folders that are given twice.
std::vector<std::string> write_report(const std::vector<std::filesystem::path>& runs, const std::filesystem::path& out,
                                      const std::vector<FieldInfo>& keys, const std::string& first_section = "");

}  // namespace giga
