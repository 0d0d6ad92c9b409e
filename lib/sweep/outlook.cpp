// Counting runs to come.
#include "sweep/outlook.hpp"

#include <algorithm>

namespace giga {
namespace {

/// Whether a trial has begun to go to a rung.
bool has_begun(const SweepProgress& progress, const std::vector<SweepRun>& open, const std::vector<uint64_t>& seeds,
               int trial, int rung) {
  const auto is_it = [&](const SweepRun& run) { return run.trial == trial && run.rung == rung; };
  return std::any_of(open.begin(), open.end(), is_it) || std::any_of(seeds.begin(), seeds.end(), [&](uint64_t seed) {
           return progress.result({trial, rung, seed});
         });
}

}  // namespace

std::vector<int> trials_expected(const SweepSpec& spec, const SweepProgress& progress, size_t n_rungs) {
  const std::vector<SweepRun> open = progress.open();
  std::vector<int> expected = {progress.n_trials()};
  for (size_t rung = 1; rung < n_rungs; ++rung) {
    int begun = 0;
    for (int trial = 0; trial < progress.n_trials(); ++trial)
      begun += has_begun(progress, open, spec.seeds, trial, static_cast<int>(rung)) ? 1 : 0;
    expected.push_back(std::max({1, expected.back() / spec.halving.factor, begun}));
  }
  return expected;
}

SweepOutlook outlook_of(const SweepSpec& spec, const SweepProgress& progress, const std::vector<int64_t>& rungs,
                        const std::map<SweepRun, double>& open) {
  const std::vector<int> expected = trials_expected(spec, progress, rungs.size());
  SweepOutlook outlook;
  for (size_t rung = 0; rung < rungs.size(); ++rung) {
    const auto from = static_cast<double>(rung > 0 ? rungs[rung - 1] : 0);
    const double piece = static_cast<double>(rungs[rung]) - from;
    int done = 0;
    for (int trial = 0; trial < progress.n_trials(); ++trial)
      for (const uint64_t seed : spec.seeds) done += progress.result({trial, static_cast<int>(rung), seed}) ? 1 : 0;
    const double runs = expected[rung] * static_cast<double>(spec.seeds.size());
    outlook.all += piece * runs;
    outlook.left += piece * (runs - done);
    for (const auto& [run, steps] : open)
      if (run.rung == static_cast<int>(rung)) outlook.left -= std::clamp(steps - from, 0.0, piece);
  }
  outlook.left = std::max(outlook.left, 0.0);
  return outlook;
}

}  // namespace giga
