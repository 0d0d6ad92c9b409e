// MetricsCsv: metrics.csv, a row of figures per update (RFC 4180).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "io/append_file.hpp"

namespace giga {

/// Named figures in a fixed order; NaN = not known.
using MetricsRow = std::vector<std::pair<std::string, double>>;

/// The header is the names of the first row; a later row with other names is an error, so that the header is true for
/// the whole file. NaN is an empty field. Each row is on its way to the disk when `write` returns: a killed run keeps
/// it.
class MetricsCsv {
 public:
  /// A new file; throws Error where it exists or cannot be written.
  explicit MetricsCsv(const std::filesystem::path& path) : file_(AppendFile::create(path)) {}
  /// Goes on behind the first `size` bytes of a file, as `size()` gave it; later rows are cut off. Throws InputError.
  MetricsCsv(const std::filesystem::path& path, uint64_t size);
  /// Throws InputError where the first `size` bytes of a file are not rows any more; a missing one is no fault.
  static void expect(const std::filesystem::path& path, uint64_t size);

  void write(const MetricsRow& row);

  uint64_t size() const { return file_.size(); }
  void flush_to_disk() const { file_.flush_to_disk(); }

 private:
  AppendFile file_;
  std::vector<std::string> columns_;
};

/// A field of a CSV file: in quotes where it must be.
std::string csv_field(const std::string& text);

}  // namespace giga
