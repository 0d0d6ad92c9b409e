// Writing of metrics.csv.
#include "io/metrics_csv.hpp"

#include <cmath>

#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {

std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? "\"\"" : std::string(1, c);
  return quoted + '"';
}

MetricsCsv::MetricsCsv(const std::filesystem::path& path) : path_(path) {
  std::error_code code;
  if (std::filesystem::exists(path, code)) throw Error(cat(path.string(), " is already there"));
  file_.open(path, std::ios::binary);
  if (!file_) throw Error(cat("cannot create ", path.string()));
}

void MetricsCsv::write(const MetricsRow& row) {
  const bool first = columns_.empty();
  std::string header, line;
  for (size_t k = 0; k < row.size(); ++k) {
    const auto& [name, value] = row[k];
    if (first) {
      columns_.push_back(name);
    } else {
      GIGA_CHECK(k < columns_.size() && columns_[k] == name, "figure '", name, "' in column ", k + 1, " of ",
                 path_.string());
    }
    header += (k ? "," : "") + csv_field(name);
    line += (k ? "," : "") + (std::isnan(value) ? std::string() : print_number(value));
  }
  GIGA_CHECK(row.size() == columns_.size(), row.size(), " figures for ", columns_.size(), " columns of ",
             path_.string());
  if (first) put(header);
  put(line);
}

void MetricsCsv::put(const std::string& line) {
  file_ << line << "\r\n" << std::flush;
  if (!file_) throw Error(cat("cannot write ", path_.string()));
}

}  // namespace giga
