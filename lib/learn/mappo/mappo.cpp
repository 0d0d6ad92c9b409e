// The learner `mappo`: an update plays a rollout of all worlds and lets each team learn from it. ppo_team.cpp has the
// algorithm itself; what follows the update here is bookkeeping.
#include <torch/types.h>

#include <atomic>
#include <cmath>
#include <numbers>

#include "core/parallel_for.hpp"
#include "core/seeds.hpp"
#include "cuda/device_clock.hpp"
#include "cuda/runtime.hpp"
#include "learn/learner.hpp"
#include "learn/libtorch_settings.hpp"
#include "learn/mappo/balance.hpp"
#include "learn/mappo/config.hpp"
#include "learn/mappo/ppo_metrics.hpp"
#include "learn/mappo/ppo_team.hpp"
#include "learn/mappo/sequence_order.hpp"
#include "learn/mappo/step_back.hpp"
#include "learn/opponents/frozen_opponent.hpp"
#include "learn/opponents/league.hpp"
#include "learn/rank_sums.hpp"
#include "learn/team_policy.hpp"
#include "ranks/divided_arrays.hpp"
#include "rollout/collector.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

class Mappo final : public Learner {
 public:
  Mappo(const LoadedRun& run, Device device, Ranks* ranks);

  Metrics update() override;
  UpdateStage stage() const override;
  int64_t updates_done() const override { return updates_; }
  int64_t agent_steps_done() const override {
    return updates_ * agent_steps_per_update(config_, sim_->params().n_agents);
  }
  Actor* actor(int team) override { return team_[team] ? &team_[team]->actor() : nullptr; }
  Player* opponent() override { return frozen_ ? &frozen_->player() : nullptr; }
  void watch(GameObserver& observer) override { collector_->watch(observer); }
  void save_critics(NamedArrays& out) const override;
  void save(NamedArrays& out) const override;
  void load(const NamedArrays& in) override;
  std::optional<Divergence> divergence() const override { return divergence_; }
  UpdateTimes times() const override { return {clock_->seconds(0, 1), clock_->seconds(1, 2)}; }
  void save_batch(NamedArrays& out) const override;
  std::string ways() const override {
    return way() + (has_one_policy(config_, run_.spec) ? "; both teams play by one policy" : "");
  }
  std::string step_way() const override { return sim_->step_way(); }
  std::string refusal() const override { return collector_->refusal(); }
  std::vector<HeadlineFigure> headline() const override {
    std::vector<HeadlineFigure> figures = {{"policy loss", nullptr, "policy_loss"},
                                           {"value loss", "value loss", "value_loss"},
                                           {"entropy", "entropy", "entropy"},
                                           {"approximate KL", "approx. KL", "approx_kl"},
                                           {"expl. variance", nullptr, "explained_variance"}};
    add_league_headline(config_.opponents, figures);
    return figures;
  }

 private:
  /// How it learns and acts.
  std::string way() const {
    const std::string& why = learning_.front()->plain_because();
    if (!why.empty())
      return cat(learning_.front()->actor_is_fused() ? "the actor learns by fused kernels, the critic by LibTorch"
                                                     : "learns by LibTorch",
                 recorder_ ? ", minibatches as CUDA graphs" : "", ", not by fused kernels: ", why);
    if (!device_.is_cuda()) return "learns by fused kernels";
    return fused_policy(learning_.front()->actor()) ? "acts and learns by fused kernels"
                                                    : "learns by fused kernels, acts by LibTorch";
  }
  void make_teams_and_worlds();
  int64_t n_own_shards() const { return config_.mappo.shards / (ranks_ ? ranks_->size() : 1); }
  WorldShares own_shares() const { return world_shares(config_.opponents, run_.config.train.n_worlds, n_own_shards()); }
  /// Of the run, after so many updates.
  double share_done(int64_t updates) const {
    return std::min(1.0, static_cast<double>(updates) / static_cast<double>(total_updates_));
  }
  double schedule_factor() const;
  void set_shaping();
  std::array<bool, kNTeams> step_back(const std::array<LeagueRecord, kNTeams>& record);
  at::Tensor order_of(int64_t update, int epoch) const;
  void save_worlds(NamedArrays& out) const;
  void load_worlds(const NamedArrays& in);
  void note_divergence(int team, const float* figures);
  std::vector<int> ranks_with(int team, PpoFault fault) const;
  Metrics metrics(double factor);

  const RunConfig config_;
  LoadedRun run_;  // with the worlds of this process
  const Device device_;
  const int64_t total_updates_;
  ParallelFor parallel_for_;
  Ranks* const ranks_;              // null: this process has all worlds
  std::unique_ptr<RankSums> sums_;  // null likewise
  std::unique_ptr<Simulator> sim_;
  std::shared_ptr<TorchRecorder> recorder_;  // null: kernel by kernel
  std::unique_ptr<PpoTeam> team_[kNTeams];   // null = scripted
  std::vector<PpoTeam*> learning_;           // those of them that are not
  std::unique_ptr<League> league_;           // null = no opponents but each other or train.opponent
  std::optional<FrozenOpponent> frozen_;     // that train.opponent names; none = a script or nobody
  Balance balance_;
  std::optional<StepBack> step_back_;
  std::array<bool, kNTeams> fallen_{};  // in this update
  std::unique_ptr<Collector> collector_;
  std::unique_ptr<DeviceClock> clock_;
  int64_t updates_ = 0;
  std::atomic<int64_t> minibatches_done_ = -1;  // of the update that goes on; -1: it collects
  std::optional<Divergence> divergence_;
};

Mappo::Mappo(const LoadedRun& run, Device device, Ranks* ranks)
    : config_(run.config),
      run_(run),
      device_(device),
      total_updates_(total_updates(run.config, run.spec.params.n_agents).value()),
      parallel_for_(device, run.config.train.n_threads, current_stream(device)),
      ranks_(ranks),
      balance_(run.config.mappo) {
  set_up_libtorch(config_.train, device);
  if (ranks_) {
    sums_ = std::make_unique<RankSums>(*ranks_, device_);
    run_.config.train.n_worlds = config_.train.n_worlds / ranks_->size();
  }
  make_teams_and_worlds();
  clock_ = make_device_clock(device, parallel_for_.stream());
}

// The stream of data: the simulator's worlds, who moves each team in them, and the collector that keeps what they see,
// do and get.
void Mappo::make_teams_and_worlds() {
  const LoadedRun& run = run_;
  SimOptions options;
  options.n_worlds = run.config.train.n_worlds;
  options.seed = seed_of(config_.seed, Purpose::training);
  options.first_world = ranks_ ? static_cast<int64_t>(ranks_->rank()) * options.n_worlds : 0;
  options.n_threads = config_.train.n_threads;
  options.compile_step = config_.train.compile_step;
  options.pairs = config_.train.pairs;
  SimSpec spec = run.spec;
  spec.params.has_term_factors = balance_.terms_fade();
  sim_ = make_simulator(spec, options, device_, parallel_for_.stream());

  // Not with ranks: where one is gone, NCCL's abort waits for the graphs that hold its sums, and these for the abort.
  if (config_.mappo.graphs && !ranks_) recorder_ = make_torch_recorder(device_);
  const SumOverRanks sum = sums_ ? sums_->over_all() : SumOverRanks{};
  const WorldShares shares = own_shares();
  const bool one_policy = has_one_policy(config_, run.spec);
  std::array<const Actor*, kNTeams> actors{};
  CollectorOptions collecting{.horizon = config_.mappo.horizon,
                              .desynchronize = config_.train.desynchronize,
                              .mirror = config_.mappo.mirror && !config_.train.opponent.is_path()};
  for (int team = 0; team < kNTeams; ++team) {
    const bool own = learns(config_.train, team);
    collecting.learns[static_cast<size_t>(team)] = own;
    if (!own) continue;
    PpoTeam* twin = one_policy ? team_[0].get() : nullptr;
    team_[team] = std::make_unique<PpoTeam>(run, team, device_, parallel_for_, shares.learning(team), sum, twin);
    team_[team]->record_minibatches(recorder_);
    learning_.push_back(team_[team].get());
    actors[static_cast<size_t>(team)] = &team_[team]->actor();
    collecting.with_state = collecting.with_state || team_[team]->needs_state();
    collecting.keep |= team_[team]->reads();
    collecting.with_final_images = collecting.with_final_images || team_[team]->critic_reads_image();
  }
  if (config_.train.opponent.is_path()) frozen_.emplace(run, device_);
  if (config_.mappo.step_back)
    step_back_.emplace(static_cast<double>(*config_.mappo.step_back), config_.opponents.pool_every_updates);
  if (has_further_opponents(config_.opponents))
    league_ = std::make_unique<League>(run, shares, actors, parallel_for_, sum);
  std::shared_ptr<TeamController> both;
  if (!league_ && actors[0] && actors[1]) both = policies_controller(*actors[0], *actors[1]);
  const auto side = [&](int team) {
    if (league_) return league_->side(team);
    if (both) return everywhere(both, *sim_);
    const Actor* actor = actors[static_cast<size_t>(team)];
    if (actor) return everywhere(policy_controller(*actor), *sim_);
    if (!frozen_) return everywhere(script_controller(config_.train.opponent.script()), *sim_);
    return frozen_->side(team, run, shares, *sim_);
  };
  collector_ = std::make_unique<Collector>(*sim_, parallel_for_, collecting, BothSides{side(0), side(1)});
  collector_->start();
}

Metrics Mappo::update() {
  if (sums_) sums_->begin();
  // A rollout: `horizon` steps of all worlds, played by the policies as they are.
  clock_->mark(0);
  minibatches_done_ = -1;
  if (league_) league_->begin();
  set_shaping();
  collector_->collect();
  clock_->mark(1);
  if (league_) league_->count(*sim_);

  const MappoConfig& c = config_.mappo;
  const double factor = schedule_factor(), done = share_done(updates_);
  const auto scale = static_cast<float>(factor);
  for (int team = 0; team < kNTeams; ++team) {
    if (!team_[team]) continue;
    team_[team]->set({.actor_step_size = scale * balance_.actor_factor(team) * c.learning_rate,
                      .critic_step_size = scale * balance_.critic_factor(team) * c.critic_learning_rate,
                      .gamma = balance_.gamma(done),
                      .clip_coef = balance_.clip_coef(done),
                      .entropy_coef = balance_.entropy_coef(team, done)});
  }

  // How much better was each action than expected?
  const Rollout& rollout = collector_->rollout();
  for (PpoTeam* team : learning_) team->compute_advantages(rollout);

  // Several passes over the rollout in minibatches, each pass in another order.
  minibatches_done_ = 0;
  for (int epoch = 0; epoch < c.n_epochs; ++epoch) {
    const at::Tensor order = order_of(updates_, epoch);
    for (PpoTeam* team : learning_) team->begin_epoch(rollout, order);
    for (int k = 0; k < c.n_minibatches; ++k, ++minibatches_done_)
      for (PpoTeam* team : learning_) team->update_minibatch(rollout, k, epoch * c.n_minibatches + k + 1);
    for (PpoTeam* team : learning_) team->end_epoch();
  }

  // The next rollout sees observations in units of this one's moments too; but for a team that does not learn now,
  // whose policy they would change.
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team] && balance_.actor_factor(team) > 0) team_[team]->update_normalizer(rollout);
  clock_->mark(2);

  ++updates_;
  Metrics figures = metrics(factor);
  if (league_) league_->end(updates_, *sim_, fallen_);
  return figures;
}

UpdateStage Mappo::stage() const {
  const MappoConfig& c = config_.mappo;
  const int64_t learned = minibatches_done_;
  if (learned < 0) return {"playing, step", collector_->steps_done(), c.horizon};
  return {"learning, minibatch", learned, static_cast<int64_t>(c.n_epochs) * c.n_minibatches};
}

/// What fades is a factor of all rewards but game_won that each world keeps (rules 5); where rewards fade by factors of
/// their own, those of the terms, and the worlds' stays 1. Kernels fill them in, so that the host need not wait.
void Mappo::set_shaping() {
  at::NoGradGuard no_grad;
  if (balance_.terms_fade()) {
    const at::Tensor factors = wrap(sim_->term_factors(), {kNRewardTerms}, sim_->device());
    for (int t = 0; t < kNRewardTerms; ++t)
      factors[t].fill_(balance_.shaping_factor(static_cast<RewardTerm>(t), share_done(updates_)));
    return;
  }
  if (!balance_.shaping_fades()) return;
  wrap(sim_->state().view().reward_factor, {sim_->n_worlds()}, sim_->device())
      .fill_(balance_.shaping_factor(share_done(updates_)));
}

/// Keeps what a team was at its best, and takes it back there where it has fallen: says which have.
std::array<bool, kNTeams> Mappo::step_back(const std::array<LeagueRecord, kNTeams>& record) {
  std::array<bool, kNTeams> fallen{};
  for (int team = 0; team < kNTeams; ++team) {
    const StepBack::Verdict verdict = step_back_->note(team, record[static_cast<size_t>(team)].scripts, updates_);
    if (verdict == StepBack::Verdict::goes_on) continue;
    if (verdict == StepBack::Verdict::fallen) {
      fallen[static_cast<size_t>(team)] = true;
      team_[team]->load("", step_back_->best(team));
      balance_.load_team(team, step_back_->best(team));
      // What the fallen networks remember means nothing to others.
      collector_->forget(team, own_shares().learning(team));
      team_[team]->forget();
    }
    NamedArrays now;
    team_[team]->save("", now);
    balance_.save_team(team, now);
    step_back_->begin(team, std::move(now));
  }
  return fallen;
}

double Mappo::schedule_factor() const {
  const double done = share_done(updates_);
  const double last = static_cast<double>(config_.mappo.final_learning_rate_factor);
  switch (config_.mappo.schedule) {
    case Schedule::constant:
      return 1;
    case Schedule::linear:
      return 1 + (last - 1) * done;
    case Schedule::cosine:
      return last + (1 - last) * 0.5 * (1 + std::cos(std::numbers::pi * done));
  }
  return 1;
}

at::Tensor Mappo::order_of(int64_t update, int epoch) const {
  const SequenceOrder order{.n_sequences = learning_.front()->n_sequences(),
                            .n_minibatches = config_.mappo.n_minibatches,
                            .n_worlds = learning_.front()->n_own_worlds(),
                            .n_shards = config_.mappo.shards,
                            .first_shard = ranks_ ? ranks_->rank() * n_own_shards() : 0,
                            .n_own_shards = n_own_shards()};
  return order.draw(
      seed_of(config_.seed, Purpose::permutation, static_cast<uint64_t>(update) << 16 | static_cast<uint64_t>(epoch)),
      device_);
}

// ---- Bookkeeping: metrics, divergence, checkpoints -----------------------------------------------------------------

void Mappo::note_divergence(int team, const float* figures) {
  for (int fault = 0; fault < kNFaults && !divergence_; ++fault) {
    const auto minibatch = static_cast<int>(figures[kFirstFault + fault]);
    if (minibatch == 0) continue;
    divergence_ = Divergence{kPpoFaultNames[static_cast<size_t>(fault)], team, updates_,
                             fault < kFaultActorGradient ? 0 : minibatch};
    if (ranks_) divergence_->ranks = ranks_with(team, static_cast<PpoFault>(fault));
  }
}

// All ranks have the same figures, so they come here together.
std::vector<int> Mappo::ranks_with(int team, PpoFault fault) const {
  const int k = divergence_->minibatch - 1, n = config_.mappo.n_minibatches;
  PpoTeam& of = *team_[team];
  const bool own =
      k < 0 ? of.is_own(fault) : of.is_own(fault, collector_->rollout(), order_of(updates_ - 1, k / n), k % n, k + 1);
  const std::vector<std::string> all = ranks_->gather(own ? "yes" : "no");
  std::vector<int> ranks;
  for (size_t rank = 0; rank < all.size(); ++rank)
    if (all[rank] == "yes") ranks.push_back(static_cast<int>(rank));
  return ranks;
}

void Mappo::save_batch(NamedArrays& out) const {
  if (!divergence_) return;
  const PpoTeam& team = *team_[divergence_->team];
  const MappoConfig& c = config_.mappo;
  const int k = divergence_->minibatch - 1;
  at::Tensor states;
  if (k < 0) {
    const int64_t most = team.n_sequences() * team.sequence_length() / c.n_minibatches;
    states = team.faulty_states(collector_->rollout(), most);
    if (states.size(0) == 0)  // the fault is that of a normaliser: in no state, or in all
      states = team.states(at::arange(most, states.options()));
  } else {
    const at::Tensor order = order_of(updates_ - 1, k / c.n_minibatches);
    states = team.minibatches(order)[static_cast<size_t>(k % c.n_minibatches)];
  }
  NamedArrays batch;
  team.save_batch(collector_->rollout(), states, batch);
  const int rank = divergence_->ranks.empty() ? 0 : divergence_->ranks.front();
  for (NamedArray& array : batch) {
    if (rank > 0) broadcast_rows(*ranks_, array, rank);  // rank 0 writes it
    out.push_back(std::move(array));
  }
}

// The only place of an update where the host waits for the device. `factor`: of the step sizes of this update.
Metrics Mappo::metrics(double factor) {
  at::Tensor figures[kNTeams];
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) figures[team] = team_[team]->figures().cpu();
  divergence_.reset();
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) note_divergence(team, figures[team].const_data_ptr<float>());
  EpisodeStats stats = sim_->take_stats();
  if (sums_ && !league_) sums_->add_host(at::from_blob(stats.rows.data(), {kNStatRows}, at::kDouble));
  if (sums_) sums_->end();
  std::array<LeagueRecord, kNTeams> record;
  if (league_) league_->read(stats, record);  // of the worlds in which both teams learn, of all ranks
  const double episodes = stats[EpisodeStat::episodes];

  Metrics out;
  out.emplace_back("learning_rate_factor", factor);
  out.emplace_back("episodes", episodes);
  out.emplace_back("episode_length", stats[EpisodeStat::length] / episodes);  // NaN where none has ended
  out.emplace_back("win_rate_0", stats[EpisodeStat::wins_0] / episodes);
  out.emplace_back("win_rate_1", stats[EpisodeStat::wins_1] / episodes);
  out.emplace_back("tie_rate", stats[EpisodeStat::ties] / episodes);
  out.emplace_back("truncated_share", stats[EpisodeStat::truncated] / episodes);
  for (int team = 0; team < kNTeams; ++team) {
    const auto of_team = [team](EpisodeStat first) { return static_cast<EpisodeStat>(static_cast<int>(first) + team); };
    out.emplace_back(cat("return_", team), stats[of_team(EpisodeStat::return_0)] / episodes);
    out.emplace_back(cat("score_", team), stats[of_team(EpisodeStat::score_0)] / episodes);
    add_ppo_metrics(config_.mappo, team, team_[team] ? figures[team].const_data_ptr<float>() : nullptr, out);
    for (int t = 0; t < kNRewardTerms; ++t)
      out.emplace_back(cat("reward_", kRewardTermNames[t], "_", team),
                       stats.term(team, static_cast<RewardTerm>(t)) / episodes);
    record[static_cast<size_t>(team)].add_metrics(team, out);
  }
  balance_.add_metrics(share_done(updates_ - 1), out);
  balance_.note(out);
  if (step_back_) {
    fallen_ = step_back(record);
    step_back_->add_metrics(out);
  }
  return out;
}

void Mappo::save_critics(NamedArrays& out) const {
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->save_critic(cat("team_", team, "/"), out);
}

void Mappo::save(NamedArrays& out) const {
  out.push_back(make_array<int64_t>("updates", {updates_}));
  save_worlds(out);
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->save(cat("team_", team, "/"), out);
  if (league_) league_->save("league/", out);
  if (frozen_) frozen_->save(out);
  balance_.save("balance/", out);
  if (step_back_) step_back_->save("step_back/", out);
}

// What there is of each world: of all ranks, so that checkpoints do not know of them.
void Mappo::save_worlds(NamedArrays& out) const {
  NamedArrays arrays;
  sim_->state().save("simulator/", arrays);
  collector_->save("collector/", arrays);
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->save_memory(cat("team_", team, "/"), arrays);
  if (league_) league_->save_worlds("league/", arrays);
  for (NamedArray& array : arrays) {
    if (sums_) sums_->gather_rows(array);
    out.push_back(std::move(array));
  }
}

void Mappo::load_worlds(const NamedArrays& in) {
  sim_->state().load("simulator/", in);
  collector_->load("collector/", in);
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->load_memory(cat("team_", team, "/"), in);
  if (league_) league_->load_worlds("league/", in, *sim_);
  if (!run_.opponents_move) return;
  // A game that is on goes on by others, who know nothing of it.
  if (league_) league_->forget_games(*sim_);
  for (int team = 0; team < kNTeams; ++team) {
    collector_->forget(team, {{0, sim_->n_worlds()}, sim_->n_worlds()});
    if (team_[team]) team_[team]->forget();
  }
}

void Mappo::load(const NamedArrays& in) {
  updates_ = array_values<int64_t>(find_array(in, "updates")).at(0);
  if (ranks_) {
    NamedArrays own;
    for (const NamedArray& array : in)
      if (array.name.starts_with("simulator/") || array.name.starts_with("collector/") ||
          array.name.ends_with("/critic_memory") || array.name == "league/counts" || array.name == "league/drawn_at")
        own.push_back(own_rows(*ranks_, array));
    load_worlds(own);
  } else {
    load_worlds(in);
  }
  for (int team = 0; team < kNTeams; ++team)
    if (team_[team]) team_[team]->load(cat("team_", team, "/"), in);
  if (league_ && league_->load("league/", in)) {
    league_->forget_games(*sim_);
    for (int team = 0; team < kNTeams; ++team) collector_->forget(team, league_->pool_worlds(team));
  }
  if (frozen_) frozen_->check_same(in);
  balance_.load("balance/", in);
  if (step_back_) step_back_->load("step_back/", in);
  if (step_back_ && run_.other_scripts) step_back_->forget();
  collector_->resume();
}

}  // namespace

std::unique_ptr<Learner> MappoAlgorithm::make(const LoadedRun& run, Device device, Ranks* ranks) {
  return std::make_unique<Mappo>(run, device, ranks);
}

}  // namespace giga
