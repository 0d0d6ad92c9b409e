#include "sweep/progress.hpp"

#include <algorithm>
#include <numeric>

#include "core/error.hpp"

namespace giga {

SweepProgress::SweepProgress(const SweepSpec& spec, int n_trials, int n_rungs)
    : seeds_(spec.seeds), goal_(spec.goal), factor_(spec.halving.factor), n_trials_(n_trials), n_rungs_(n_rungs) {}

int SweepProgress::add_trial() { return n_trials_++; }

void SweepProgress::begin(int trial, int rung) {
  GIGA_CHECK(trial >= 0 && trial < n_trials_ && rung >= 0 && rung < n_rungs_, "trial ", trial, ", rung ", rung);
  begun_[trial] = std::max(rung, begun_.contains(trial) ? begun_[trial] : 0);
}

void SweepProgress::finish(const SweepRun& run, const SweepResult& result) {
  begin(run.trial, run.rung);
  results_[run] = result;
}

void SweepProgress::reopen_failed() {
  std::erase_if(results_, [](const auto& known) {
    return known.second.has_failed() && known.second.exit_code != SweepResult::kDiverged;
  });
}

int SweepProgress::n_failed() const {
  return static_cast<int>(
      std::count_if(results_.begin(), results_.end(), [](const auto& known) { return known.second.has_failed(); }));
}

int SweepProgress::failure_code() const {
  if (n_failed() == 0) return 0;
  const auto diverged = [](const auto& known) { return known.second.exit_code == SweepResult::kDiverged; };
  const auto failed_otherwise = [&](const auto& known) { return known.second.has_failed() && !diverged(known); };
  if (std::any_of(results_.begin(), results_.end(), failed_otherwise)) return SweepResult::kFailed;
  return std::all_of(results_.begin(), results_.end(), diverged) ? SweepResult::kDiverged : 0;
}

const SweepResult* SweepProgress::result(const SweepRun& run) const {
  const auto found = results_.find(run);
  return found == results_.end() ? nullptr : &found->second;
}

std::vector<SweepRun> SweepProgress::open() const {
  std::vector<SweepRun> runs;
  for (const auto& [trial, rung] : begun_)
    for (const uint64_t seed : seeds_)
      if (const SweepRun run{trial, rung, seed}; !result(run)) runs.push_back(run);
  return runs;
}

int SweepProgress::reached(int trial) const {
  for (int rung = n_rungs_ - 1; rung >= 0; --rung)
    if (std::all_of(seeds_.begin(), seeds_.end(), [&](uint64_t seed) { return result({trial, rung, seed}); }))
      return rung;
  return -1;
}

std::vector<double> SweepProgress::values(int trial, int rung) const {
  std::vector<double> values;
  for (const uint64_t seed : seeds_)
    if (const SweepResult* found = result({trial, rung, seed}); found && found->value) values.push_back(*found->value);
  return values;
}

std::optional<double> SweepProgress::value(int trial, int rung) const {
  const std::vector<double> known = values(trial, rung);
  if (known.size() < seeds_.size()) return std::nullopt;
  return std::accumulate(known.begin(), known.end(), 0.0) / static_cast<double>(known.size());
}

/// Whether all trials have begun, and none runs at this rung or below.
bool SweepProgress::is_settled(int rung) const {
  return static_cast<int>(begun_.size()) == n_trials_ && std::none_of(begun_.begin(), begun_.end(), [&](const auto& b) {
           return b.second <= rung && reached(b.first) < b.second;
         });
}

/// Trials that have a value at a rung, the best first.
std::vector<int> SweepProgress::standing(int rung) const {
  std::vector<std::pair<int, double>> there;  // trial, value
  for (const auto& [trial, last] : begun_)    // one that failed further on leaves its place to others
    if (const auto known = value(trial, rung); known && value(trial, reached(trial))) there.emplace_back(trial, *known);
  std::stable_sort(there.begin(), there.end(), [&](auto& a, auto& b) { return better(a.second, b.second); });
  std::vector<int> trials;
  for (const auto& [trial, known] : there) trials.push_back(trial);
  return trials;
}

std::optional<SweepJob> SweepProgress::next() const {
  for (int rung = n_rungs_ - 2; rung >= 0; --rung) {
    const std::vector<int> trials = standing(rung);
    for (size_t k = 0; k < trials.size() / static_cast<size_t>(factor_); ++k)
      if (begun_.at(trials[k]) == rung) return SweepJob{trials[k], rung + 1};
  }
  for (int trial = 0; trial < n_trials_; ++trial)
    if (!begun_.contains(trial)) return SweepJob{trial, 0};
  // Few trials: the best goes on all the same, but only when nobody else comes to its rung, so these are asked last.
  for (int rung = 0; rung < n_rungs_ - 1; ++rung) {
    const std::vector<int> trials = standing(rung);
    if (!trials.empty() && trials.size() < static_cast<size_t>(factor_) && begun_.at(trials[0]) == rung &&
        is_settled(rung))
      return SweepJob{trials[0], rung + 1};
  }
  return std::nullopt;
}

std::vector<int> SweepProgress::ranking() const {
  std::vector<int> trials(static_cast<size_t>(n_trials_));
  std::iota(trials.begin(), trials.end(), 0);
  std::stable_sort(trials.begin(), trials.end(), [&](int a, int b) {
    const int at = reached(a), other = reached(b);
    const std::optional<double> x = value(a, at), y = value(b, other);
    if (x.has_value() != y.has_value()) return x.has_value();
    if (at != other) return at > other;
    return x && better(*x, *y);
  });
  return trials;
}

std::optional<std::pair<int, double>> SweepProgress::best() const {
  if (n_trials_ == 0) return std::nullopt;
  const int trial = ranking().front(), rung = reached(trial);
  const std::optional<double> known = rung >= 0 ? value(trial, rung) : std::nullopt;
  if (!known) return std::nullopt;
  return std::pair(trial, *known);
}

int SweepProgress::n_compared() const {
  int n = 0;
  for (int trial = 0; trial < n_trials_; ++trial) n += reached(trial) >= 0 ? 1 : 0;
  return n;
}

}  // namespace giga
