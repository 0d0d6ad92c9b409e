// Processes of runs.
#include "apps/run_process.hpp"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "apps/fork_to_exec.hpp"
#include "apps/own_program.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "io/run_folder.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

/// As a shell says it: 128 + the signal that ended the process.
int code_of(int status) { return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status); }

}  // namespace

RunProcess::RunProcess(const std::vector<std::string>& arguments, const fs::path& log) {
  std::vector<std::string> words = {"gigastep"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const std::string file = log.string(), program = own_program();
  pid_ = fork_to_exec();
  if (pid_ < 0) throw Error(cat("cannot start a run: ", std::strerror(errno)));
  if (pid_ > 0) return;
  const int out = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (out >= 0) {
    ::dup2(out, STDOUT_FILENO);
    ::dup2(out, STDERR_FILENO);
  }
  ::execv(program.c_str(), argv.data());
  ::_exit(127);
}

RunProcess::~RunProcess() {
  if (code_) return;
  stop();
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
}

std::optional<int> RunProcess::ended() {
  int status = 0;
  if (!code_ && ::waitpid(pid_, &status, WNOHANG) == pid_) code_ = code_of(status);
  return code_;
}

void RunProcess::stop() const {
  if (!code_) ::kill(pid_, SIGTERM);
}

void clear_beginning(const WantedRun& run) {
  if (!has_checkpoint(run.folder)) fs::remove_all(run.folder);
}

std::vector<std::string> arguments_for(const WantedRun& run) {
  const std::string stop = cat("train.stop_at_agent_steps=", run.stop_at ? std::to_string(*run.stop_at) : "none");
  if (has_checkpoint(run.folder)) return {"resume", run.folder.string(), "--quiet", "--set", stop};
  std::vector<std::string> words = {"train", run.config.string(), "--run-dir", run.folder.string(), "--quiet"};
  for (const std::string& assignment : run.overrides) words.insert(words.end(), {"--set", assignment});
  words.insert(words.end(), {"--set", stop});
  return words;
}

void write_config_files(const fs::path& folder, const LoadedRun& run) {
  const RunConfig config = for_run_folder(run.config);
  const std::string scenario = print_scenario(run.scenario);
  write_file(folder / "scenario.yaml", scenario);
  if (is_path(config.scenario)) write_file(folder / config.scenario, scenario);
  write_file(folder / "config.yaml", print_yaml(config, true));
}

std::string tail_of(const fs::path& log) {
  constexpr size_t kMost = 600;
  std::error_code code;
  if (!fs::exists(log, code)) return "";
  const std::string text = read_file(log);
  if (text.size() <= kMost) return text;
  // Whole lines, the last one in any case.
  const size_t end = text.find_last_not_of('\n'), last = end == std::string::npos ? end : text.rfind('\n', end);
  const size_t first = text.find('\n', text.size() - kMost);
  return text.substr(last == std::string::npos ? 0 : std::min(first, last) + 1);
}

}  // namespace giga
