// Signals.
#include "apps/stop_request.hpp"

#include <csignal>

namespace giga {
namespace {

constexpr int kSignals[] = {SIGINT, SIGTERM, SIGUSR1, SIGHUP};

// A handler has nothing but globals to write to.
volatile std::sig_atomic_t first_signal = 0;

void note(int signal) {
  if (first_signal == 0) first_signal = signal;
}

}  // namespace

StopRequest::StopRequest() {
  std::signal(SIGPIPE, SIG_IGN);  // nobody reads what is told any more: no reason to lose the work
  for (const int signal : kSignals) {
    struct sigaction action {};
    if (signal == SIGHUP && sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN)
      continue;  // nohup
    action.sa_handler = note;
    // Calls that a signal interrupts go on; the second SIGINT finds the default action, which ends the process.
    action.sa_flags = SA_RESTART | (signal == SIGINT ? static_cast<int>(SA_RESETHAND) : 0);
    sigaction(signal, &action, nullptr);
  }
}

StopRequest::~StopRequest() {
  for (const int signal : kSignals) {
    struct sigaction action {};
    if (sigaction(signal, nullptr, &action) == 0 && action.sa_handler == note) std::signal(signal, SIG_DFL);
  }
  std::signal(SIGPIPE, SIG_DFL);
}

int StopRequest::signal() { return first_signal; }

const char* signal_name(int signal) {
  switch (signal) {
    case SIGINT:
      return "SIGINT";
    case SIGTERM:
      return "SIGTERM";
    case SIGUSR1:
      return "SIGUSR1";
    case SIGHUP:
      return "SIGHUP";
    default:
      return "a signal";
  }
}

}  // namespace giga
