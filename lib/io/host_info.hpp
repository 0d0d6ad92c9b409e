// What machine this is: for run.json and benchmark results.
#pragma once

#include <cstdint>
#include <string>

namespace giga {

struct HostInfo {
  std::string cpu;           ///< model name
  int cores = 0;             ///< that this process may use
  int64_t memory_bytes = 0;  ///< of the machine
  std::string os;            ///< "Debian GNU/Linux 12 (bookworm)"
  std::string kernel;        ///< "Linux 6.1.0 x86_64"
};
HostInfo host_info();

/// Memory that this process holds now (resident set), bytes; 0 where not known.
int64_t resident_bytes();

/// "2026-11-21T12:53:18Z".
std::string utc_now();

}  // namespace giga
