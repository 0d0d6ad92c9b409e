// Reading a growing metrics.csv.
#include "sweep/run_tail.hpp"

#include <cmath>
#include <fstream>

#include "core/error.hpp"
#include "report/run_data.hpp"
#include "sweep/outcome.hpp"

namespace giga {
namespace {

/// The bytes of a file from `begin` on; empty where it cannot be read (any more).
std::string bytes_from(const std::filesystem::path& file, uint64_t begin, uint64_t end) {
  std::ifstream in(file, std::ios::binary);
  std::string bytes(end - begin, '\0');
  if (!in.seekg(static_cast<std::streamoff>(begin)) ||
      !in.read(bytes.data(), static_cast<std::streamsize>(end - begin)))
    return "";
  return bytes;
}

}  // namespace

RunTail::RunTail(const SweepSpec& spec, const std::filesystem::path& run) : spec_(spec), file_(run / "metrics.csv") {
  restart();
}

void RunTail::restart() {
  read_ = 0;
  header_.clear();
  agent_steps_ = update_seconds_ = speed_ = 0;
  known_.assign(spec_.metric.size(), {});
}

std::optional<double> RunTail::metric() const { return metric_of_values(spec_, known_); }

void RunTail::look() {
  std::error_code code;
  const uint64_t size = std::filesystem::file_size(file_, code);
  if (code || size < read_) restart();
  if (code || size == read_) return;
  // With the last byte that was read: an end of a line, unless the file was cut and has grown again.
  const uint64_t from = read_ > 0 ? read_ - 1 : 0;
  std::string bytes = bytes_from(file_, from, size);
  if (bytes.empty()) return;
  if (read_ > 0 && bytes[0] != '\n') return restart();
  if (read_ > 0) bytes.erase(0, 1);
  bytes.resize(bytes.rfind('\n') + 1);  // npos + 1 = 0: no line is complete
  read_ += bytes.size();
  if (header_.empty()) {
    const size_t end = bytes.find('\n');
    if (end == std::string::npos) return;
    header_ = bytes.substr(0, end + 1);
    bytes.erase(0, end + 1);
  }
  if (!bytes.empty()) take(bytes);
}

void RunTail::take(const std::string& rows) {
  const MetricsTable table = parse_metrics(header_ + rows, file_.string());
  const auto column = [&](const std::string& name) -> const std::vector<double>& {
    const std::vector<double>* found = table.find(name);
    if (!found) throw InputError(cat(file_.string(), " has no column ", name));
    return *found;
  };
  // A row that was written again after a stop may lie behind one that was read.
  if (column("agent_steps").front() <= agent_steps_) return restart();
  agent_steps_ = column("agent_steps").back();
  speed_ = column("agent_steps_per_second").back();
  for (const double seconds : column("update_seconds"))
    if (!std::isnan(seconds)) update_seconds_ += seconds;
  for (size_t k = 0; k < known_.size(); ++k)
    for (const double value : column(spec_.metric[k]))
      if (!std::isnan(value)) known_[k].push_back(value);
}

}  // namespace giga
