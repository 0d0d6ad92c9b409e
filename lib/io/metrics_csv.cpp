// Writing of metrics.csv.
#include "io/metrics_csv.hpp"

#include <cmath>
#include <sstream>
#include <system_error>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

constexpr const char* kLineEnd = "\r\n";

}  // namespace

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

MetricsCsv::MetricsCsv(const std::filesystem::path& path, uint64_t size) : file_(AppendFile::resume(path, size)) {
  const std::string text = read_file(path);
  std::istringstream header(text.substr(0, text.find(kLineEnd)));
  for (std::string name; std::getline(header, name, ',');) columns_.push_back(name);
}

void MetricsCsv::expect(const std::filesystem::path& path, uint64_t size) {
  AppendFile::expect(path, size);
  std::error_code code;
  if (size == 0 || !std::filesystem::exists(path, code)) return;
  if (!read_file(path).substr(0, size).ends_with(kLineEnd))
    AppendFile::fail_changed(path, cat("no row ends at byte ", size, ", as the checkpoint says"));
}

void MetricsCsv::write(const MetricsRow& row) {
  const bool first = columns_.empty();
  std::string header, line;
  for (size_t k = 0; k < row.size(); ++k) {
    const auto& [name, value] = row[k];
    GIGA_CHECK(csv_field(name) == name, "a figure named '", name, "'");  // `resume` splits the header at its commas
    if (first) {
      columns_.push_back(name);
    } else if (k >= columns_.size() || columns_[k] != name) {
      throw InputError(cat(file_.path().string(), ": column ", k + 1, " is ",
                           k < columns_.size() ? columns_[k] : "missing", " where this gigastep writes ", name,
                           "; go on with the gigastep that began the run, or move the file away: it is begun anew"));
    }
    header += (k ? "," : "") + name;
    line += (k ? "," : "") + (std::isnan(value) ? std::string() : print_number(value));
  }
  GIGA_CHECK(row.size() == columns_.size(), row.size(), " figures for ", columns_.size(), " columns of ",
             file_.path().string());
  file_.append((first ? header + kLineEnd : "") + line + kLineEnd);
}

}  // namespace giga
