// Reading of run folders.
#include "report/run_data.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

#include "core/error.hpp"
#include "io/files.hpp"
#include "rating/sheet.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (size_t begin = 0;;) {
    const size_t comma = line.find(',', begin);
    fields.push_back(line.substr(begin, comma == std::string_view::npos ? comma : comma - begin));
    if (comma == std::string_view::npos) return fields;
    begin = comma + 1;
  }
}

/// The complete lines of a text, without their ends.
std::vector<std::string_view> complete_lines(std::string_view text) {
  std::vector<std::string_view> lines;
  for (size_t end; (end = text.find('\n')) != std::string_view::npos; text.remove_prefix(end + 1)) {
    std::string_view line = text.substr(0, end);
    if (line.ends_with('\r')) line.remove_suffix(1);
    lines.push_back(line);
  }
  return lines;
}

/// What a column of an older run is called today.
std::string present_name(std::string name) {
  for (const auto& [before, now] : {std::pair<std::string_view, std::string_view>{"win_share", "win_rate"},
                                    {"loss_share", "loss_rate"},
                                    {"tie_share", "tie_rate"}})
    if (const size_t at = name.find(before); at != std::string::npos) name.replace(at, before.size(), now);
  return (name.starts_with("information_") ? "mutual_" : "") + name;
}

double parse_figure(std::string_view field, const std::string& column, const std::string& at) {
  if (field.empty()) return std::numeric_limits<double>::quiet_NaN();
  double value = 0;
  const auto [end, code] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (code != std::errc() || end != field.data() + field.size())
    throw InputError(cat(at, ": column ", column, ": '", field, "' is not a number"));
  return value;
}

void check_names(const std::vector<std::string>& names, const std::string& file) {
  for (size_t k = 0; k < names.size(); ++k) {
    if (names[k].empty()) throw InputError(cat(file, ":1: column ", k + 1, " has no name"));
    if (std::find(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(k), names[k]) !=
        names.begin() + static_cast<std::ptrdiff_t>(k))
      throw InputError(cat(file, ":1: the column ", names[k], " is there twice"));
  }
  for (const char* needed : {"agent_steps", "seconds"})
    if (std::find(names.begin(), names.end(), needed) == names.end())
      throw InputError(cat(file, ":1: there is no column ", needed));
}

/// The columns that charts run along: known in every row; agent-steps grow, time does not run back.
void check_axes(const MetricsTable& table, const std::string& file) {
  const std::vector<double>&steps = *table.find("agent_steps"), &seconds = *table.find("seconds");
  for (size_t row = 0; row < table.rows(); ++row) {
    const std::string at = cat(file, ":", row + 2);
    if (!std::isfinite(steps[row]) || (row > 0 && steps[row] <= steps[row - 1]))
      throw InputError(cat(at, ": agent_steps is ", steps[row], "; it must grow from row to row"));
    if (!std::isfinite(seconds[row]) || (row > 0 && seconds[row] < seconds[row - 1]))
      throw InputError(cat(at, ": seconds is ", seconds[row], "; it must not fall from row to row"));
  }
}

Node read_map(const fs::path& file) {
  Document document = parse_yaml_text(read_file(file), file.string());  // JSON is YAML
  if (!document.root.is_map()) throw InputError(cat(file.string(), ":1: a map is needed here"));
  return std::move(document.root);
}

/// Nothing where the run was not rated.
std::optional<RatingData> read_ratings(const fs::path& folder) {
  std::error_code code;
  if (!fs::exists(folder / RatingFiles::kJson, code)) return std::nullopt;
  RatingData ratings{read_map(folder / RatingFiles::kJson), {}};
  for (const auto& [name, along] : {std::pair{RatingFiles::kRatingPicture, "agent_steps"},
                                    {RatingFiles::kRatingTimePicture, "seconds"},
                                    {RatingFiles::kWinRatePicture, "agent_steps"},
                                    {RatingFiles::kWinRateTimePicture, "seconds"},
                                    {RatingFiles::kMatrixPicture, ""}})
    if (fs::exists(folder / name, code)) ratings.pictures.push_back({read_file(folder / name), along});
  return ratings;
}

}  // namespace

const std::vector<double>* MetricsTable::find(const std::string& name) const {
  const auto at = std::find(names.begin(), names.end(), name);
  return at == names.end() ? nullptr : &columns[static_cast<size_t>(at - names.begin())];
}

MetricsTable parse_metrics(const std::string& text, const std::string& file) {
  const std::vector<std::string_view> lines = complete_lines(text);
  if (lines.size() < 2) throw InputError(cat(file, ": there is no row yet: the run has not done its first update"));
  MetricsTable table;
  for (const std::string_view name : split(lines[0])) table.names.push_back(present_name(std::string(name)));
  check_names(table.names, file);
  table.columns.resize(table.names.size());
  for (size_t k = 1; k < lines.size(); ++k) {
    const std::string at = cat(file, ":", k + 1);
    const std::vector<std::string_view> fields = split(lines[k]);
    if (fields.size() != table.names.size())
      throw InputError(cat(at, ": ", fields.size(), " fields, but the header names ", table.names.size(), " columns"));
    for (size_t c = 0; c < fields.size(); ++c) table.columns[c].push_back(parse_figure(fields[c], table.names[c], at));
  }
  check_axes(table, file);
  return table;
}

RunData read_run(const fs::path& folder) {
  std::error_code code;
  if (!fs::is_directory(folder, code))
    throw InputError(fs::exists(folder, code) ? cat(folder.string(), " is a file, not the folder of a run")
                                              : cat("there is no run folder ", folder.string()));
  if (!fs::exists(folder / "metrics.csv", code))
    throw InputError(cat("the folder ", folder.string(), " is not a run: it holds no metrics.csv"));
  RunData run;
  run.name = names_of_folders({folder}).front();
  run.config = read_map(folder / "config.yaml");
  run.scenario = read_map(folder / "scenario.yaml");
  run.info = read_map(folder / "run.json");
  for (const fs::path& file : list_resumes(folder)) run.resumes.push_back(read_map(file));
  const fs::path metrics = folder / "metrics.csv";
  run.metrics = parse_metrics(read_file(metrics), metrics.string());
  run.ratings = read_ratings(folder / RatingFiles::kFolder);
  return run;
}

}  // namespace giga
