#include "learn/evolution/evolution.hpp"

#include <torch/types.h>

#include <cmath>
#include <limits>

#include "core/parallel_for.hpp"
#include "core/seeds.hpp"
#include "cuda/device_clock.hpp"
#include "learn/evolution/evolving_team.hpp"
#include "learn/evolution/opponents.hpp"
#include "learn/libtorch_settings.hpp"
#include "learn/opponents/frozen_opponent.hpp"
#include "learn/opponents/record.hpp"
#include "learn/rank_sums.hpp"
#include "learn/registry.hpp"
#include "learn/team_policy.hpp"
#include "ranks/ranks.hpp"
#include "rollout/population_games.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"
#include "scripted/script.hpp"

namespace giga {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// Those of this rank's members; `ranks` null: of all.
PopulationGamesOptions games_options(const RunConfig& c, const Ranks* ranks) {
  PopulationGamesOptions o;
  o.n_members = c.population.population_size / (ranks ? ranks->size() : 1);
  if (ranks) o.first_world = ranks->rank() * o.n_members * c.population.n_worlds();
  o.n_worlds = c.population.n_worlds();
  o.n_rounds = c.population.n_rounds();
  o.n_populations = populations_at_a_time(c);
  o.common_random_numbers = c.population.common_random_numbers;
  o.greedy = c.population.greedy;
  o.seed = seed_of(c.seed, Purpose::training);
  o.n_threads = c.train.n_threads;
  o.max_steps = c.population.max_steps;
  o.compile_step = c.train.compile_step;
  o.pairs = c.train.pairs;
  return o;
}

/// In a race for waypoints other rewards, such as prices on dying, tell members apart far more often than a waypoint.
Objective objective_of(const RunConfig& c, const SimParams& p) {
  if (c.population.objective != Objective::automatic) return c.population.objective;
  return p.win.by == WinBy::waypoints ? Objective::score : Objective::mean_return;
}

/// Fitness [M] of a population's results [M, E, kNStatRows], sums over the `n_rounds` episodes of each world.
at::Tensor fitness_of(const at::Tensor& results, int64_t n_rounds, int team, Objective objective) {
  const auto mean_of = [&](EpisodeStat first, int offset = 0) {
    return results.select(2, static_cast<int64_t>(first) + offset).mean(1) / n_rounds;
  };
  switch (objective) {
    case Objective::automatic:
      break;  // see objective_of
    case Objective::mean_return:
      return mean_of(EpisodeStat::return_0, team);
    case Objective::win_rate:
      return mean_of(EpisodeStat::wins_0, team) + 0.5 * mean_of(EpisodeStat::ties);
    case Objective::score:
      return mean_of(EpisodeStat::score_0, team);
  }
  GIGA_CHECK(false, "an objective that was not settled");
  return {};
}

/// What a generation of a population came to, of all ranks.
struct PopulationResults {
  at::Tensor fitness;  // [M] on the device
  at::Tensor stats;    // [E, kNStatRows] fp64 on the device: sums over the members
};

/// Figures of a population's generation, on the host.
struct PopulationFigures {
  std::vector<double> stats;   // [kNStatRows] sums over its episodes
  std::vector<float> learned;  // [kNEvolutionFigures]
  LeagueRecord record;
};

class Evolution final : public Learner {
 public:
  Evolution(const LoadedRun& run, Device device, Ranks* ranks, const MakeStrategy& make_strategy);

  Metrics update() override;
  UpdateStage stage() const override { return {"playing a generation"}; }
  std::optional<Divergence> divergence() const override { return divergence_; }
  UpdateTimes times() const override { return {clock_->seconds(0, 1), clock_->seconds(1, 2)}; }
  void save_batch(NamedArrays& out) const override;
  std::string step_way() const override { return games_->simulator().step_way(); }
  std::string refusal() const override { return games_->refusal(); }
  std::vector<HeadlineFigure> headline() const override {
    std::vector<HeadlineFigure> figures = {{"mean fitness", "mean fitness", "fitness_mean"},
                                           {"best fitness", nullptr, "fitness_best"},
                                           {"wins in play", "wins in play", "win_rate"},
                                           {"sigma", "sigma", "sigma"},
                                           {"step", nullptr, "step_norm"}};
    add_league_headline(config_.opponents, figures);
    return figures;
  }
  int64_t updates_done() const override { return generations_; }
  int64_t agent_steps_done() const override { return agent_steps_; }
  Player* opponent() override { return frozen_ ? &frozen_->player() : nullptr; }
  Actor* actor(int team) override { return team_[team] ? &team_[team]->actor() : nullptr; }
  void watch(GameObserver& observer) override { games_->watch(observer); }
  void save(NamedArrays& out) const override;
  void load(const NamedArrays& in) override;

 private:
  PopulationShare share() const;
  std::vector<int> teams_of_generation() const;
  bool has_evolved(int team) const;
  Population population_of(int team) const;
  std::vector<PopulationResults> results_of(const std::vector<int>& teams);
  Metrics metrics(const std::vector<Population>& populations, const std::vector<PopulationResults>& results);
  PopulationFigures figures_of(const Population& population, const at::Tensor& by_world);
  void team_metrics(int team, const PopulationFigures* figures, Metrics& out) const;

  const RunConfig config_;
  const SimSpec spec_;
  const ParallelFor parallel_for_;
  Ranks* const ranks_;                           // null: this process plays all members
  std::unique_ptr<RankSums> sums_;               // null likewise
  std::unique_ptr<EvolvingTeam> team_[kNTeams];  // null = scripted or frozen
  std::optional<FrozenOpponent> frozen_;         // that train.opponent names; none = a script or nobody
  std::unique_ptr<PopulationGames> games_;
  std::unique_ptr<DeviceClock> clock_;
  at::Tensor no_networks_;  // [1, P] stands in for the networks of a scripted or frozen team
  int64_t generations_ = 0, agent_steps_ = 0;
  uint32_t next_draws_ = 0;  // of the next generation, whose episodes may be shorter than those before were
  std::optional<Divergence> divergence_;
};

Evolution::Evolution(const LoadedRun& run, Device device, Ranks* ranks, const MakeStrategy& make_strategy)
    : config_(run.config),
      spec_(run.spec),
      parallel_for_(device, run.config.train.n_threads, current_stream(device)),
      ranks_(ranks) {
  check_precision(run, device);
  set_up_libtorch(config_.train, device);
  // Without NCCL what GPUs tell each other goes by the host, too.
  if (ranks_) sums_ = std::make_unique<RankSums>(*ranks_, built_with_nccl() ? device : Device{});
  const Actor* network = nullptr;
  for (int team = 0; team < kNTeams; ++team) {
    if (!learns(config_.train, team)) continue;
    team_[team] = std::make_unique<EvolvingTeam>(run, team, device, make_strategy, parallel_for_, share());
    network = &team_[team]->actor();
  }
  PopulationGamesOptions options = games_options(config_, ranks_);
  if (config_.train.opponent.is_path()) {
    frozen_.emplace(run, device);
    options.opponent_team = 1 - config_.train.learning_team;
    options.opponent = frozen_->player().controller(options.opponent_team, spec_);
  }
  games_ = std::make_unique<PopulationGames>(spec_, options, *network, parallel_for_);
  no_networks_ = at::zeros({1, network->parameters().size()}, at::TensorOptions().device(torch_device(device)));
  clock_ = make_device_clock(device, parallel_for_.stream());
}

PopulationShare Evolution::share() const {
  if (!ranks_) return {};
  return {ranks_->rank(), ranks_->size(), [sums = sums_.get()](const at::Tensor& x) { return sums->gather(x); }};
}

std::vector<int> Evolution::teams_of_generation() const {
  if (!config_.train.opponent.is_self_play()) return {config_.train.learning_team};
  if (config_.population.turns == Turns::together) return {0, 1};
  return {static_cast<int>(generations_ / config_.population.generations_per_turn % kNTeams)};
}

Population Evolution::population_of(int team) const {
  const EvolvingTeam* other = team_[1 - team].get();
  const int64_t worlds = config_.population.n_worlds();
  Population population{team, team_[team]->ask(), other ? other->pool().networks() : no_networks_, {}};
  if (other)
    population.opponent =
        assign_opponents(config_.opponents, worlds, other->pool().weights(config_.opponents),
                         {seed_of(config_.seed, Purpose::training), static_cast<uint32_t>(generations_), team},
                         generations_of(config_.population, team, generations_));
  else
    population.opponent.assign(static_cast<size_t>(worlds),
                               frozen_ ? 0 : network_of_script(config_.train.opponent.script()));
  return population;
}

/// Since the pools took something in: one whose turn it never was would push a past policy out by a copy of the newest.
bool Evolution::has_evolved(int team) const {
  if (!config_.train.opponent.is_self_play()) return true;
  const auto turns = [&](int64_t generations) { return generations_of(config_.population, team, generations); };
  return turns(generations_) > turns(generations_ - config_.opponents.pool_every_updates);
}

Metrics Evolution::update() {
  clock_->mark(0);
  const std::vector<int> teams = teams_of_generation();
  std::vector<Population> populations;
  for (const int team : teams) populations.push_back(population_of(team));
  games_->play(populations, next_draws_);
  next_draws_ += games_->draw_steps();
  clock_->mark(1);

  if (sums_) sums_->begin();
  const std::vector<PopulationResults> results = results_of(teams);
  for (size_t k = 0; k < teams.size(); ++k) team_[teams[k]]->tell(results[k].fitness);
  ++generations_;
  clock_->mark(2);
  Metrics figures = metrics(populations, results);
  if (sums_) sums_->end();
  // After the results, which belong to the pool that was played against.
  if (generations_ % config_.opponents.pool_every_updates == 0)
    for (int team = 0; team < kNTeams; ++team)
      if (team_[team] && has_evolved(team)) team_[team]->pool().keep();
  return figures;
}

// One message of each rank: how well its members did, and in which episodes. Where it is NCCL's the host does not wait.
std::vector<PopulationResults> Evolution::results_of(const std::vector<int>& teams) {
  std::vector<PopulationResults> results;
  for (size_t k = 0; k < teams.size(); ++k) {
    const at::Tensor all = games_->results(k);
    results.push_back({fitness_of(all, config_.population.n_rounds(), teams[k], objective_of(config_, spec_.params)),
                       all.sum(0, false, at::kDouble)});
  }
  if (!ranks_) return results;
  std::vector<at::Tensor> mine;
  for (const PopulationResults& r : results) mine.insert(mine.end(), {r.fitness.to(at::kDouble), r.stats.flatten()});
  const at::Tensor all = sums_->gather(at::cat(mine)).view({ranks_->size(), -1});
  int64_t at = 0;
  const auto next = [&](const at::Tensor& like) {  // [ranks, numbers of each]
    at += like.numel();
    return all.narrow(1, at - like.numel(), like.numel());
  };
  for (PopulationResults& r : results) {
    r.fitness = next(r.fitness).reshape({-1}).to(r.fitness.scalar_type());
    r.stats = next(r.stats).sum(0).view(r.stats.sizes());
  }
  return results;
}

void Evolution::team_metrics(int team, const PopulationFigures* f, Metrics& out) const {
  const auto add = [&](const char* name, double value) { out.emplace_back(cat(name, "_", team), value); };
  const auto stat = [&](EpisodeStat s, int offset = 0) {
    return f ? f->stats[static_cast<size_t>(s) + static_cast<size_t>(offset)] /
                   f->stats[static_cast<size_t>(EpisodeStat::episodes)]
             : kUnknown;
  };
  const auto learned = [&](EvolutionFigure k) { return f ? static_cast<double>(f->learned[k]) : kUnknown; };
  add("win_rate", stat(EpisodeStat::wins_0, team));
  add("loss_rate", stat(EpisodeStat::wins_0, 1 - team));
  add("return", stat(EpisodeStat::return_0, team));
  add("score", stat(EpisodeStat::score_0, team));
  add("fitness_mean", learned(kFigFitnessMean));
  add("fitness_best", learned(kFigFitnessBest));
  add("fitness_deviation", learned(kFigFitnessDeviation));
  add("not_finite", learned(kFigNotFinite));
  add("sigma", learned(kFigSigma));
  add("parameter_norm", learned(kFigParameterNorm));
  add("step_norm", learned(kFigStepNorm));
  for (int t = 0; t < kNRewardTerms; ++t) {
    const int row = kNEpisodeStats + team * kNRewardTerms + t;
    add(cat("reward_", kRewardTermNames[t]).c_str(), stat(EpisodeStat{}, row));
  }
  (f ? f->record : LeagueRecord{}).add_metrics(team, out);
}

// Reads the figures of a population that played, and counts its games against the other team's pool.
PopulationFigures Evolution::figures_of(const Population& population, const at::Tensor& by_world) {
  const at::Tensor sums = by_world.sum(0), learned = team_[population.team]->figures().cpu();
  PopulationFigures f;
  f.stats.assign(sums.const_data_ptr<double>(), sums.const_data_ptr<double>() + kNStatRows);
  f.learned.assign(learned.const_data_ptr<float>(), learned.const_data_ptr<float>() + kNEvolutionFigures);
  EvolvingTeam* other = team_[1 - population.team].get();
  for (size_t e = 0; other && e < population.opponent.size(); ++e) {
    const double* stats = by_world.const_data_ptr<double>() + e * kNStatRows;
    const auto stat = [stats](EpisodeStat s) { return stats[static_cast<size_t>(s)]; };
    const GameCount games{stat(EpisodeStat::episodes), stat(of_team(EpisodeStat::wins_0, population.team)),
                          stat(EpisodeStat::ties)};
    const int32_t opponent = population.opponent[e];
    if (opponent < 0) f.record.scripts += games;
    if (opponent <= 0) continue;
    f.record.pool += games;
    other->pool().note(opponent, games.episodes, games.points());
  }
  return f;
}

// Besides the games (Game::play), the one place of a generation where the host waits for the device.
Metrics Evolution::metrics(const std::vector<Population>& populations, const std::vector<PopulationResults>& results) {
  std::unique_ptr<PopulationFigures> figures[kNTeams];
  double episodes = 0, steps = 0, ties = 0, truncated = 0;
  games_->synchronize();
  divergence_.reset();
  for (size_t k = 0; k < populations.size(); ++k) {
    const int team = populations[k].team;
    auto f = std::make_unique<PopulationFigures>(figures_of(populations[k], results[k].stats.cpu()));
    const auto sum = [&f](EpisodeStat s) { return f->stats[static_cast<size_t>(s)]; };
    episodes += sum(EpisodeStat::episodes);
    steps += sum(EpisodeStat::length);
    ties += sum(EpisodeStat::ties);
    truncated += sum(EpisodeStat::truncated);
    if (f->learned[kFigDiverged] > 0 && !divergence_)
      divergence_ =
          Divergence{"new mean or sigma of the population", team, generations_, 0, team_[team]->faulty_ranks()};
    figures[team] = std::move(f);
  }
  agent_steps_ += static_cast<int64_t>(std::llround(steps)) * games_->simulator().params().n_agents;

  Metrics out;
  out.emplace_back("episodes", episodes);
  out.emplace_back("episode_length", steps / episodes);
  out.emplace_back("tie_rate", ties / episodes);
  out.emplace_back("truncated_share", truncated / episodes);
  for (int team = 0; team < kNTeams; ++team) team_metrics(team, figures[team].get(), out);
  return out;
}

void Evolution::save_batch(NamedArrays& out) const {
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team] && team_[team]->fitness().defined())
      out.push_back(to_array(cat("batch/fitness_", team), team_[team]->fitness()));
}

void Evolution::save(NamedArrays& out) const {
  out.push_back(make_array<int64_t>("updates", {generations_}));
  out.push_back(make_array<int64_t>("agent_steps", {agent_steps_}));
  out.push_back(make_array<int64_t>("next_draws", {next_draws_}));
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->save(cat("team_", team, "/"), out);
  if (frozen_) frozen_->save(out);
}

void Evolution::load(const NamedArrays& in) {
  if (frozen_) frozen_->check_same(in);
  generations_ = array_values<int64_t>(find_array(in, "updates")).at(0);
  agent_steps_ = array_values<int64_t>(find_array(in, "agent_steps")).at(0);
  const NamedArray* const draws = look_for_array(in, "next_draws");  // older checkpoints lack it
  next_draws_ = draws ? static_cast<uint32_t>(array_values<int64_t>(*draws).at(0))
                      : static_cast<uint32_t>(generations_) * games_->draw_steps();
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->load(cat("team_", team, "/"), in);
}

}  // namespace

std::unique_ptr<Learner> make_evolution(const LoadedRun& run, Device device, Ranks* ranks,
                                        const MakeStrategy& make_strategy) {
  return std::make_unique<Evolution>(run, device, ranks, make_strategy);
}

}  // namespace giga
