// Which updates count.
#include "sweep/rate_meter.hpp"

#include <algorithm>

namespace giga {

void RateMeter::begin(int runs) {
  runs_ = runs;
  seen_.clear();
  sum_steps_ = sum_seconds_ = 0;
  sum_readings_ = 0;
}

void RateMeter::count(const RunReading& from, const RunReading& to) {
  sum_steps_ += to.agent_steps - from.agent_steps;
  sum_seconds_ += to.update_seconds - from.update_seconds;
  ++sum_readings_;
}

void RateMeter::look(const std::vector<RunReading>& going) {
  const bool all_there = static_cast<int>(going.size()) == runs_ &&
                         std::all_of(going.begin(), going.end(), [](const RunReading& r) { return r.has_new_rows; });
  for (const RunReading& now : going) {
    const auto [at, is_new] = seen_.try_emplace(now.id, Seen{now});
    Seen& seen = at->second;
    if (!all_there || is_new) {
      seen.row = now;
      seen.is_whole = false;
      continue;
    }
    if (now.agent_steps <= seen.row.agent_steps) continue;
    if (seen.is_whole) {
      count(seen.row, now);
      seen.has_counted = true;
    }
    seen.row = now;
    seen.is_whole = true;
  }
}

void RateMeter::ended(const RunReading& first, const RunReading& last) {
  const auto seen = seen_.find(last.id);
  const bool has_counted = seen != seen_.end() && seen->second.has_counted;
  if (!has_counted && last.agent_steps > first.agent_steps) count(first, last);
  if (seen != seen_.end()) seen_.erase(seen);
}

std::optional<double> RateMeter::rate() const {
  if (sum_seconds_ < seconds_ * runs_ || sum_readings_ < readings_ * runs_ || sum_steps_ <= 0) return std::nullopt;
  return runs_ * sum_steps_ / sum_seconds_;
}

}  // namespace giga
