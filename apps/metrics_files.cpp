#include "apps/metrics_files.hpp"

#include <ctime>
#include <string>
#include <vector>

namespace giga {
namespace {

double now() { return static_cast<double>(std::time(nullptr)); }

}  // namespace

MetricsFiles::MetricsFiles(const RunFolder& folder, const LoadedRun& run)
    : csv_(folder.metrics_file()), events_(TensorBoardEvents::create(folder.events_file(), now())) {
  std::vector<std::string> goals;
  for (const auto& [name, value] : evaluation_metrics(run.config, {}))
    if (name.starts_with("win_rate")) goals.push_back(comparison_tag(name));
  const std::string yaml = print_yaml(run.config, false);
  events_.hyper_parameters(flat_hyper_parameters(parse_yaml_text(yaml, "config").root), goals, now());
  events_.text("config", "```yaml\n" + yaml + "```", 0, now());
  events_.text("scenario", "```yaml\n" + print_yaml(run.scenario, false) + "```", 0, now());
}

MetricsFiles::MetricsFiles(const RunFolder& folder, const RunCursor& cursor)
    : csv_(folder.metrics_file(), cursor.metrics_bytes),
      events_(TensorBoardEvents::resume(folder.events_file(), cursor.events_bytes)) {}

void MetricsFiles::expect(const RunFolder& folder, const RunCursor& cursor) {
  MetricsCsv::expect(folder.metrics_file(), cursor.metrics_bytes);
  AppendFile::expect(folder.events_file(), cursor.events_bytes);
}

void MetricsFiles::write(int64_t updates, int64_t agent_steps, const MetricsRow& row, const MetricsRow& win_rates) {
  csv_.write(row);
  events_.scalars(agent_steps, now(), row);
  if (!win_rates.empty()) events_.comparison(updates, now(), win_rates);
}

void MetricsFiles::end() { events_.session_end(true, now()); }

void MetricsFiles::flush_to_disk() {
  csv_.flush_to_disk();
  events_.flush_to_disk();
}

void MetricsFiles::note_sizes(RunCursor& cursor) const {
  cursor.metrics_bytes = csv_.size();
  cursor.events_bytes = events_.size();
}

}  // namespace giga
