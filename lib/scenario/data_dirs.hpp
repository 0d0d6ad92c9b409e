// Where the files that come with the program are: scenarios/ and configs/.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace giga {

/// Folders that are searched in this order; each holds `scenarios/` (and `configs/`).
using DataDirs = std::vector<std::filesystem::path>;

/// $GIGASTEP_DATA_DIR if set (it must hold `scenarios/`); then ../share/gigastep beside the folder of the executable;
/// then the source tree from which it was built. Those that exist.
DataDirs data_dirs();

/// First file of that relative name, for example "configs/quickstart.yaml".
std::optional<std::filesystem::path> find_data_file(const DataDirs& dirs, const std::filesystem::path& relative);

/// Names of the YAML files in a folder of that name, for example "configs", in order.
std::vector<std::string> data_names(const DataDirs& dirs, const std::string& folder);

}  // namespace giga
