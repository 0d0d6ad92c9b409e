#include "runs.hpp"

#include <algorithm>
#include <sstream>

#include "io/run_folder.hpp"
#include "io/state_hash.hpp"

namespace giga::test {

const char* const kShortConfig = R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {n_worlds: 16, total_agent_steps: 1024, n_threads: 1}   # an update is 16 x 8 x 2 = 256 agent-steps
mappo: {horizon: 8, n_minibatches: 2, n_epochs: 1, actor: {hidden: [8]}, critic: {hidden: [8]}}
eval: {episodes: 8, every_updates: 2, opponents: [random]}
checkpoint: {every_updates: 1, keep: 2}
)";

std::string state_hash(const Workplace& here, const std::string& checkpoint) {
  return state_sha256(find_checkpoint((here.path() / checkpoint).string()).checkpoint.arrays);
}

std::string timeless_metrics(const Workplace& here, const std::string& run) {
  const CsvTable table = parse_csv(here.read(run + "/metrics.csv"));
  std::string text;
  for (size_t column = 0; column < table.columns.size(); ++column) {
    const std::string& name = table.columns[column];
    if (name.ends_with("seconds") || name.ends_with("per_second")) continue;
    text += name;
    for (const auto& row : table.rows) text += ' ' + row[column];
    text += '\n';
  }
  return text;
}

std::string metrics_difference(const std::string& a, const std::string& b) {
  std::istringstream x(a), y(b);
  for (std::string p, q; std::getline(x, p) && std::getline(y, q);)
    if (p != q) return p + "\n" + q;
  return a.size() == b.size() ? "" : "one has more columns than the other";
}

size_t rows_of_column(const Workplace& here, const std::string& run, const std::string& column) {
  size_t known = 0;
  const CsvTable table = parse_csv(here.read(run + "/metrics.csv"));
  for (size_t row = 0; row < table.rows.size(); ++row) known += table.cell(row, column).empty() ? 0 : 1;
  return known;
}

size_t metrics_rows(const Workplace& here, const std::string& run) {
  if (!here.has(run + "/metrics.csv")) return 0;
  const std::string text = here.read(run + "/metrics.csv");
  const auto lines = static_cast<size_t>(std::count(text.begin(), text.end(), '\n'));
  return lines > 0 ? lines - 1 : 0;
}

}  // namespace giga::test
