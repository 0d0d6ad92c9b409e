// StopRequest: whether the process was asked to end, by SIGINT (Ctrl-C), SIGTERM, SIGUSR1 (Slurm's warning) or
// SIGHUP (its terminal is gone).
#pragma once

namespace giga {

/// While it lives these signals are noted instead of ending the process; a second SIGINT ends it at once.
class StopRequest {
 public:
  StopRequest();
  ~StopRequest();
  StopRequest(const StopRequest&) = delete;
  StopRequest& operator=(const StopRequest&) = delete;

  /// The first signal that came; 0 = none.
  static int signal();
};

/// "SIGTERM".
const char* signal_name(int signal);

}  // namespace giga
