#include "learn/evolution/evolving_team.hpp"

#include <limits>

#include "core/seeds.hpp"
#include "learn/evolution/fitness.hpp"
#include "learn/team_policy.hpp"

namespace giga {
EvolvingTeam::EvolvingTeam(const LoadedRun& run, int team, Device device, const MakeStrategy& make_strategy,
                           const ParallelFor& parallel_for, const PopulationShare& share)
    : actor_(make_actor(run, team, device)),
      strategy_(make_strategy(
          run.config, {seed_of(run.config.seed, Purpose::training), team, actor_.parameters().matrices(), share},
          actor_.parameters().values(), parallel_for)),
      pool_(run.config.opponents.pool_size, actor_.parameters().values().detach()),
      figures_(at::zeros({kNEvolutionFigures}, strategy_->mean().options())) {}

void EvolvingTeam::tell(const at::Tensor& fitness) {
  at::NoGradGuard no_grad;
  fitness_ = fitness;
  const at::Tensor old_mean = strategy_->mean().clone();
  const at::Tensor sound = strategy_->tell(fitness);
  actor_.bound_log_std(strategy_->mean());  // the strategy's own: what it saves, and asks from next, is bounded too

  const at::Tensor finite = at::isfinite(fitness);
  const at::Tensor count = finite.sum().clamp_min(1), clean = at::where(finite, fitness, 0.0);
  const at::Tensor average = clean.sum() / count;
  const at::Tensor deviation = (at::where(finite, fitness - average, 0.0).square().sum() / count).sqrt();
  const at::Tensor best = at::where(finite, fitness, -std::numeric_limits<double>::infinity()).max();
  const at::Tensor &mean = strategy_->mean(), &sigma = strategy_->sigma();
  figures_.copy_(at::stack({average, best, deviation, count_not_finite(fitness).squeeze(0), sigma.mean(), mean.norm(),
                            (mean - old_mean).norm(), sound.logical_not().to(at::kFloat)}));
  show_mean();
}

void EvolvingTeam::show_mean() {
  at::NoGradGuard no_grad;
  actor_.parameters().values().copy_(strategy_->mean());
  pool_.set_present(strategy_->mean());
}

void EvolvingTeam::save(const std::string& prefix, NamedArrays& out) const {
  actor_.save(prefix + "actor/", out);
  strategy_->save(prefix + "strategy/", out);
  pool_.save(prefix + "pool/", out);
}

void EvolvingTeam::load(const std::string& prefix, const NamedArrays& in) {
  strategy_->load(prefix + "strategy/", in);
  pool_.load(prefix + "pool/", in);
  show_mean();
}

}  // namespace giga
