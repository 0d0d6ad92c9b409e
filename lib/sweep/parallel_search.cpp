// When one run more is worth it.
#include "sweep/parallel_search.hpp"

#include <cmath>

#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

std::string runs_at_once(int runs) { return counted(runs, "runs") + " at once"; }

}  // namespace

ParallelSearch::ParallelSearch(int most) : most_(most) { GIGA_CHECK(most >= 1, most); }

std::string ParallelSearch::stay(int runs) {
  runs_ = runs;
  settled_ = true;
  return cat("; ", runs_at_once(runs), " from here on");
}

std::string ParallelSearch::measured(double rate) {
  GIGA_CHECK(!settled_ && rate > 0, runs_, " runs, ", rate, " agent-steps/s");
  std::string text = cat("parallel: ", runs_at_once(runs_), ": ", print_short(rate), " agent-steps/s");
  if (runs_ > 1) {
    const double gain = rate / before_ - 1;
    text += cat(", ", std::lround(std::abs(gain) * 100), gain < 0 ? " % less" : " % more", " than with ", runs_ - 1);
    if (gain < kGain) return text + cat(", where ", std::lround(kGain * 100), " % more are wanted") + stay(runs_ - 1);
  }
  if (runs_ == most_) return text + ", the most that this machine has cores for" + stay(runs_);
  before_ = rate;
  ++runs_;
  return text + cat("; trying ", runs_);
}

std::string ParallelSearch::failed() {
  GIGA_CHECK(!settled_ && runs_ > 1, runs_);
  const std::string text = cat("parallel: a run failed while ", runs_at_once(runs_), " were tried");
  return text + stay(runs_ - 1);
}

}  // namespace giga
