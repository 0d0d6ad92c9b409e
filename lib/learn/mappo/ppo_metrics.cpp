#include "learn/mappo/ppo_metrics.hpp"

#include <limits>

#include "core/error.hpp"
#include "math/ppo_figures.hpp"

namespace giga {

void add_ppo_metrics(const MappoConfig& config, int team, const float* figures, Metrics& out) {
  const auto add = [&](const char* name, double value) { out.emplace_back(cat(name, "_", team), value); };
  const auto f = [&](PpoFigure k) {
    return figures ? static_cast<double>(figures[k]) : std::numeric_limits<double>::quiet_NaN();
  };
  const double rows = f(kFigRows), steps = config.n_epochs * config.n_minibatches;
  add("policy_loss", f(kFigPolicyLoss) / rows);
  add("value_loss", f(kFigValueLoss) / rows);
  if (config.view_coef > 0) add("view_loss", f(kFigViewLoss) / rows);
  add("entropy", f(kFigEntropy) / rows);
  add("approx_kl", f(kFigLastKl));
  add("clip_fraction", f(kFigClipped) / rows);
  add("explained_variance", f(kFigExplained));
  add("actor_grad_norm", f(kFigActorNorm) / steps);
  add("critic_grad_norm", f(kFigCriticNorm) / steps);
  if (config.view_coef > 0) add("view_grad_norm", f(kFigViewNorm) / steps);
  add("first_ratio_error", f(kFigFirstRatioError));
  add("mutual_information", f(kFigMutualInformation));
  add("living_share", f(kFigLiving));
  add("skipped_share", f(kFigSkipped) / steps);
}

}  // namespace giga
