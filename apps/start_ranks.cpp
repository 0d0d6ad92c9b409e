#include "apps/start_ranks.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "apps/commands.hpp"
#include "apps/fork_to_exec.hpp"
#include "apps/own_program.hpp"
#include "apps/stop_request.hpp"
#include "apps/training.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "ranks/ranks.hpp"

namespace giga {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds kGrace{30};
/// Where a run has diverged, all ranks know it, and the first one still writes its state.
constexpr std::chrono::seconds kGraceToWrite{600};
constexpr std::chrono::milliseconds kPoll{20};
constexpr int kEndedBySignal = 128;

/// The words of this process's command line, without --ranks or --gpus.
std::vector<std::string> own_words() {
  const std::string line = read_file("/proc/self/cmdline");
  std::vector<std::string> words;
  for (size_t at = 0; at < line.size();) {
    const size_t end = line.find('\0', at);
    words.push_back(line.substr(at, end - at));
    at = end == std::string::npos ? line.size() : end + 1;
  }
  for (size_t k = 1; k < words.size(); ++k)
    for (const std::string option : {"--ranks", "--gpus"}) {
      const auto at = words.begin() + static_cast<std::ptrdiff_t>(k);
      if (words[k] != option && !words[k].starts_with(option + "=")) continue;
      words.erase(at, at + (words[k] == option ? 2 : 1));
      return words;
    }
  return words;
}

/// The environment of a rank: the variables that torchrun would set.
std::vector<std::string> variables_of(int rank, int n, int port) {
  std::map<std::string, std::string> all;
  for (char** v = environ; *v; ++v) {
    const std::string line = *v;
    const size_t equals = line.find('=');
    if (equals != std::string::npos) all[line.substr(0, equals)] = line.substr(equals + 1);
  }
  const auto cores = static_cast<int>(std::thread::hardware_concurrency());
  all.try_emplace("OMP_NUM_THREADS", std::to_string(std::max(1, cores / n)));
  all["RANK"] = all["LOCAL_RANK"] = std::to_string(rank);
  all["WORLD_SIZE"] = all["LOCAL_WORLD_SIZE"] = std::to_string(n);
  all["MASTER_ADDR"] = "127.0.0.1";
  all["MASTER_PORT"] = std::to_string(port);
  all["TORCHELASTIC_USE_AGENT_STORE"] = "True";
  all["TORCHELASTIC_RESTART_COUNT"] = "0";
  std::vector<std::string> lines;
  for (const auto& [name, value] : all) lines.push_back(cat(name, "=", value));
  return lines;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
  std::vector<char*> all;
  for (std::string& text : texts) all.push_back(text.data());
  all.push_back(nullptr);
  return all;
}

int start(std::vector<std::string> words, std::vector<std::string> variables) {
  const std::vector<char*> argv = pointers(words), envp = pointers(variables);
  const std::string program = own_program();
  const int pid = fork_to_exec();
  if (pid < 0) throw Error(cat("cannot start a rank: ", std::strerror(errno)));
  if (pid > 0) return pid;
  ::execve(program.c_str(), argv.data(), envp.data());
  ::_exit(127);
}

/// Whether a process takes SIGINT for a request to stop; no longer where it has had one, which the next would end
/// (StopRequest).
bool awaits_interrupt(int pid) {
  const std::string status = read_file(cat("/proc/", pid, "/status"));
  const auto has = [&status](const char* mask) {  // "SigCgt:\t0000000000000002"
    const size_t at = status.find(mask);
    const std::string digits = at == std::string::npos ? "0" : status.substr(at + std::strlen(mask), 24);
    return (std::strtoull(digits.c_str(), nullptr, 16) >> (SIGINT - 1) & 1) != 0;
  };
  return has("SigCgt:") && !has("SigPnd:") && !has("ShdPnd:");
}

/// The processes; killed and waited for where they live at the end.
class Children {
 public:
  explicit Children(int n) {
    const std::vector<std::string> words = own_words();
    for (int rank = 0; rank < n; ++rank) pids_.push_back(start(words, variables_of(rank, n, server_.port())));
  }
  ~Children() {
    send(SIGKILL);
    for (size_t rank = 0; rank < pids_.size(); ++rank)
      if (pids_[rank] > 0) ::waitpid(pids_[rank], nullptr, 0);
  }
  Children(const Children&) = delete;
  Children& operator=(const Children&) = delete;

  void send(int signal) const {
    for (const int pid : pids_)
      if (pid > 0) ::kill(pid, signal);
  }

  /// Asks all to stop. A terminal sends SIGINT to all processes, `kill` to this one alone: who has had none gets it, so
  /// that it tells the signal by its name, and the others one that they ignore by now.
  void stop(int signal) {
    asked_ = signal;
    for (const int pid : pids_)
      if (pid > 0) ::kill(pid, signal == SIGINT && !awaits_interrupt(pid) ? SIGTERM : signal);
  }

  /// Notes who has ended. Returns whether all have.
  bool look() {
    bool all = true;
    for (size_t rank = 0; rank < pids_.size(); ++rank) {
      int status = 0;
      if (pids_[rank] > 0 && ::waitpid(pids_[rank], &status, WNOHANG) == pids_[rank]) note(rank, status);
      all = all && pids_[rank] == 0;
    }
    return all;
  }
  std::optional<int> failure() const { return failure_; }
  /// Whether the request to stop ended one that did not yet listen to it.
  bool ended_early() const { return ended_early_; }
  int code_of_rank_0() const { return code_of_rank_0_; }

 private:
  void note(size_t rank, int status) {
    pids_[rank] = 0;
    const bool killed = WIFSIGNALED(status);
    const int code = killed ? kFailed : WEXITSTATUS(status);
    if (rank == 0) code_of_rank_0_ = code;
    const bool by_request = asked_ != 0 && (WTERMSIG(status) == asked_ || WTERMSIG(status) == SIGTERM);
    if (killed && by_request) ended_early_ = true;
    if (killed)
      server_.report_failure(cat("rank ", rank, " of ", pids_.size(), " was ended by signal ", WTERMSIG(status), " (",
                                 ::strsignal(WTERMSIG(status)), ")"));
    const bool stopped = code == kOutOfTime || code > kEndedBySignal;  // as all have agreed
    if (code != 0 && !stopped && !failure_) failure_ = code;
  }

  RankServer server_;
  std::vector<int> pids_;  // 0: it has ended
  std::optional<int> failure_;
  int code_of_rank_0_ = 0;
  int asked_ = 0;  // the signal of the request to stop
  bool ended_early_ = false;
};

}  // namespace

int start_ranks(int n) {
  const StopRequest signals;
  Children children(n);
  int forwarded = 0;
  std::optional<Clock::time_point> failed_at;
  while (!children.look()) {
    if (const int signal = StopRequest::signal(); signal != 0 && forwarded == 0) {
      forwarded = signal;
      std::this_thread::sleep_for(kPoll);  // until a terminal's has reached all
      children.stop(signal);
    }
    if (children.failure() && !failed_at) failed_at = Clock::now();
    const auto grace = children.failure() == kDiverged ? kGraceToWrite : kGrace;
    if (failed_at && Clock::now() - *failed_at > grace) children.send(SIGKILL);
    std::this_thread::sleep_for(kPoll);
  }
  if (children.ended_early()) {
    std::cerr << "stopped (" << signal_name(forwarded) << ") before all ranks had begun" << std::endl;
    return kEndedBySignal + forwarded;
  }
  const int code = children.failure().value_or(children.code_of_rank_0());
  return forwarded == SIGINT && code == kEndedBySignal + SIGTERM ? kEndedBySignal + SIGINT : code;
}

}  // namespace giga
