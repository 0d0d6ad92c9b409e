// Running gigastep, and reading YAML, JSON and CSV from it.
#include "program.hpp"

#include <stdlib.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <system_error>

#include "core/error.hpp"
#include "io/files.hpp"

namespace giga::test {
namespace fs = std::filesystem;

const char* const kTinyConfig = R"(scenario: identical_2_vs_2_void
device: cpu
train: {n_worlds: 64, total_agent_steps: 12_000}   # an update is 64 x 16 x 4 = 4096 agent-steps
mappo: {horizon: 16, n_minibatches: 2, n_epochs: 2}
eval: {episodes: 32, every_updates: 2, opponents: [random, circle]}
checkpoint: {every_updates: 1, keep: 2}
)";

namespace {

fs::path temporary_folder() {
  std::string name = (fs::temp_directory_path() / "gigastep_app_XXXXXX").string();
  GIGA_CHECK(::mkdtemp(name.data()), "no temporary folder ", name);
  return name;
}

std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? "'\\''" : std::string(1, c);
  return text + "'";
}

std::vector<std::string> split(const std::string& line, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : line) {
    if (c == separator) {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

}  // namespace

Workplace::Workplace() : path_(temporary_folder()), streams_(temporary_folder()) {}
Workplace::~Workplace() {
  std::error_code code;
  fs::remove_all(path_, code);
  fs::remove_all(streams_, code);
}

Outcome Workplace::run(const std::vector<std::string>& arguments, const std::string& program) const {
  // Threads of LibTorch that wait by spinning would take the cores from each other where tests run side by side.
  std::string command = "cd " + quoted(path_.string()) + " && OMP_WAIT_POLICY=passive " + quoted(program);
  for (const std::string& argument : arguments) command += " " + quoted(argument);
  const std::string out = (streams_ / "out").string(), err = (streams_ / "err").string();
  command += " >" + quoted(out) + " 2>" + quoted(err) + " </dev/null";
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(out), read_file(err)};
}

void Workplace::write(const std::string& name, const std::string& text) const {
  fs::create_directories((path_ / name).parent_path());
  std::ofstream(path_ / name) << text;
}

std::string Workplace::read(const std::string& name) const { return read_file(path_ / name); }

std::vector<std::string> Workplace::entries() const {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(path_))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

::testing::AssertionResult contains(const std::string& text, std::initializer_list<std::string> parts) {
  for (const std::string& part : parts)
    if (text.find(part) == std::string::npos)
      return ::testing::AssertionFailure() << "no '" << part << "' in '" << text << "'";
  return ::testing::AssertionSuccess();
}

const Node& at(const Document& json, std::initializer_list<std::string> path) {
  const Node* node = &json.root;
  for (const std::string& key : path) {
    const Node* next = nullptr;
    if (node->is_map()) next = node->find(key);
    if (node->is_sequence() && std::stoul(key) < node->items.size()) next = &node->items[std::stoul(key)];
    if (!next) throw Error("no '" + key + "' in " + print_node(*node));
    node = next;
  }
  return *node;
}

double number_at(const Document& json, std::initializer_list<std::string> path) {
  const Node& node = at(json, path);
  char* end = nullptr;
  const double value = std::strtod(node.text.c_str(), &end);
  GIGA_CHECK(node.is_scalar() && !node.quoted && end != node.text.c_str() && *end == '\0', node.shown(),
             " is no number");
  return value;
}

const std::string& CsvTable::cell(size_t row, const std::string& column) const {
  const auto found = std::find(columns.begin(), columns.end(), column);
  GIGA_CHECK(found != columns.end(), "no column ", column);
  return rows.at(row).at(static_cast<size_t>(found - columns.begin()));
}

CsvTable parse_csv(const std::string& text) {
  CsvTable table;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    GIGA_CHECK(!line.empty() && line.back() == '\r', "a line of CSV without CR: ", line);
    line.pop_back();
    if (table.columns.empty()) {
      table.columns = split(line, ',');
    } else {
      table.rows.push_back(split(line, ','));
      GIGA_CHECK(table.rows.back().size() == table.columns.size(), "a row of another length: ", line);
    }
  }
  return table;
}

}  // namespace giga::test
