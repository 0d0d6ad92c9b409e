// Running gigastep, and reading YAML, JSON and CSV from it.
#include "program.hpp"

#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <system_error>

#include "core/error.hpp"
#include "io/files.hpp"

namespace giga::test {
namespace fs = std::filesystem;

// Paths of the build are in this file alone, so that the others compile to the same anywhere.
const std::string kGigastep = GIGASTEP_EXECUTABLE;

std::string fault_library() {
  struct Link {
    fs::path path = fs::temp_directory_path() / ("gigastep_fault_" + std::to_string(getpid()) + ".so");
    Link() { fs::create_symlink(GIGASTEP_FAULT_LIBRARY, path); }
    ~Link() {
      std::error_code error;
      fs::remove(path, error);
    }
  };
  static const Link link;
  return link.path.string();
}

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

Process::Process(const fs::path& folder, const std::vector<std::string>& arguments, const std::string& program,
                 const fs::path& out, const fs::path& err, const Environment& environment)
    : pid_(-1), out_(out), err_(err) {
  std::vector<char*> words = {const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) words.push_back(const_cast<char*>(argument.c_str()));
  words.push_back(nullptr);
  pid_ = ::fork();
  GIGA_CHECK(pid_ >= 0, "fork");
  if (pid_ > 0) return;
  const auto to_file = [](const fs::path& path, int stream) {
    ::dup2(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), stream);
  };
  ::dup2(::open("/dev/null", O_RDONLY), STDIN_FILENO);
  to_file(out, STDOUT_FILENO);
  to_file(err, STDERR_FILENO);
  // Threads of LibTorch that wait by spinning would take the cores from each other where tests run side by side.
  ::setenv("OMP_WAIT_POLICY", "passive", 1);
  for (const auto& [name, value] : environment) ::setenv(name.c_str(), value.c_str(), 1);
  if (::chdir(folder.c_str()) == 0) ::execvp(program.c_str(), words.data());
  ::_exit(127);
}

Process::~Process() {
  if (pid_ < 0) return;
  ::kill(pid_, SIGKILL);
  ::waitpid(pid_, nullptr, 0);
}

void Process::send(int signal) const { ::kill(pid_, signal); }

Outcome Process::wait() {
  int status = 0;
  GIGA_CHECK(::waitpid(pid_, &status, 0) == pid_, "waitpid");
  pid_ = -1;
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : WIFSIGNALED(status) ? 128 + WTERMSIG(status) : -1;
  return {code, read_file(out_), read_file(err_)};
}

std::unique_ptr<Process> Workplace::start(const std::vector<std::string>& arguments, const std::string& program,
                                          const Environment& environment) const {
  return std::make_unique<Process>(path_, arguments, program, streams_ / "out", streams_ / "err", environment);
}

Outcome Workplace::run(const std::vector<std::string>& arguments, const std::string& program,
                       const Environment& environment) const {
  return start(arguments, program, environment)->wait();
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
