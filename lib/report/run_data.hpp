// RunData: what a run folder says about its run, read back for a report.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "config/document.hpp"
#include "config/settings.hpp"

namespace giga {

/// metrics.csv by columns. NaN = an empty field.
struct MetricsTable {
  std::vector<std::string> names;
  std::vector<std::vector<double>> columns;  ///< [names][rows]

  size_t rows() const { return columns.empty() ? 0 : columns.front().size(); }
  /// Values of a column; nullptr where there is none.
  const std::vector<double>* find(const std::string& name) const;
};

/// A picture, and along which x axis of the page's charts it is ("agent_steps", "seconds"); "" = along none of them.
struct RatingPicture {
  std::string svg, along;
};

/// What `gigastep rate` wrote into a run folder.
struct RatingData {
  Node results;                         ///< ratings.json
  std::vector<RatingPicture> pictures;  ///< rating, win rate, cross-play, as far as they are there
};

struct RunData {
  std::string name;           ///< of the folder
  Node config;                ///< config.yaml: all keys
  Node scenario;              ///< scenario.yaml: all keys
  Node info;                  ///< run.json
  std::vector<Node> resumes;  ///< resume_001.json, ...
  MetricsTable metrics;
  std::optional<RatingData> ratings;
  std::string replays;  ///< where the page of its replays is, as a link of the report; empty: there is none
};

/// Reads a run folder. A run that still goes on is fine: a last line that is not complete is left out. Throws
/// InputError naming file and line where a file is missing or damaged, or no row is there yet.
RunData read_run(const std::filesystem::path& folder);

/// The same for the text of a metrics.csv; `file` is its name in messages. Columns agent_steps (growing) and seconds
/// are needed.
MetricsTable parse_metrics(const std::string& text, const std::string& file);

}  // namespace giga
