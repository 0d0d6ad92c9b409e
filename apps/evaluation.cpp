// Matches of learned teams against scripts, as figures and as a table.
#include "apps/evaluation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "core/error.hpp"
#include "core/seeds.hpp"
#include "math/wilson.hpp"
#include "rollout/policy_controllers.hpp"

namespace giga {

MatchOptions evaluation_options(const LoadedRun& run, Device device, const Learner& learner) {
  const auto updates = static_cast<uint64_t>(learner.updates_done());
  return {.episodes = run.config.eval.episodes,
          .seed = seed_of(run.config.seed, Purpose::evaluation, updates),
          .device = device,
          .n_threads = run.config.train.n_threads,
          .pairs = run.config.train.pairs};
}

std::vector<TeamResult> evaluate(const LoadedRun& run, const MatchOptions& options, Learner& learner,
                                 const WatchedPair* recorded) {
  const EvalConfig& config = run.config.eval;
  std::vector<std::shared_ptr<TeamController>> scripts;
  for (const Scripted opponent : config.opponents) scripts.push_back(script_controller(opponent));
  // Team after team, so that the worlds of a policy lie side by side.
  std::vector<Pairing> pairs;
  std::array<size_t, kNTeams> first{};  // of the team's pairs
  for (int team = 0; team < kNTeams; ++team) {
    const auto side = static_cast<size_t>(team);
    first[side] = pairs.size();
    const Actor* const actor = learner.actor(team);
    if (!actor) continue;
    const std::shared_ptr<TeamController> learned = policy_controller(*actor, acts_greedily(run.config));
    for (const auto& script : scripts) {
      Pairing& pair = pairs.emplace_back();
      pair.side[side] = learned;
      pair.side[1 - side] = script;
    }
  }
  const std::vector<MatchResult> matches = play_matches(run.spec, pairs, options, recorded);

  std::vector<TeamResult> results;
  for (size_t k = 0; k < scripts.size(); ++k)
    for (int team = 0; team < kNTeams; ++team)
      if (learner.actor(team))
        results.push_back({team, name_of(config.opponents[k]), matches.at(first[static_cast<size_t>(team)] + k)});
  return results;
}

double evaluation_score(const std::vector<TeamResult>& results) {
  double score = std::numeric_limits<double>::infinity();
  for (int team = 0; team < kNTeams; ++team) {
    double sum = 0;
    int count = 0;
    for (const TeamResult& r : results) {
      if (r.team != team) continue;
      sum += r.share(r.wins());
      ++count;
    }
    if (count > 0) score = std::min(score, sum / count);
  }
  return std::isfinite(score) ? score : -1;
}

MetricsRow evaluation_metrics(const RunConfig& config, const std::vector<TeamResult>& results) {
  MetricsRow row;
  for (const Scripted opponent : config.eval.opponents) {
    for (int team = 0; team < kNTeams; ++team) {
      constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
      double win_rate = kUnknown, loss_rate = kUnknown, mean_return = kUnknown;
      for (const TeamResult& r : results) {
        if (r.team != team || r.opponent != name_of(opponent)) continue;
        win_rate = r.share(r.wins());
        loss_rate = r.share(r.losses());
        mean_return = r.match.mean_return[team];
      }
      const std::string of = cat(team, "_vs_", name_of(opponent));
      row.emplace_back("win_rate_" + of, win_rate);
      row.emplace_back("loss_rate_" + of, loss_rate);
      row.emplace_back("mean_return_" + of, mean_return);
    }
  }
  return row;
}

std::string results_table(const std::vector<TeamResult>& results) {
  std::string table =
      "team  against          episodes   wins  [95 % interval]   losses    ties      return  length (steps)\n";
  for (const TeamResult& r : results) {
    const Interval ci = wilson95(r.wins(), r.match.episodes);
    char line[160];
    std::snprintf(line, sizeof line, "%4d  %-15s %9d  %.3f  [%.3f, %.3f]    %.3f   %.3f  %10.4g  %14.1f\n", r.team,
                  r.opponent.c_str(), r.match.episodes, r.share(r.wins()), ci.lo, ci.hi, r.share(r.losses()),
                  r.share(r.match.ties), r.match.mean_return[r.team], r.match.mean_length);
    table += line;
  }
  return table;
}

}  // namespace giga
