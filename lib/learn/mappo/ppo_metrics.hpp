// The columns of metrics.csv that an update of mappo has for each team.
#pragma once

#include "learn/learner.hpp"
#include "learn/mappo/config.hpp"

namespace giga {

/// `figures`: those of the team (math/ppo_figures.hpp), on the host; null: it does not learn, and the columns are NaN.
void add_ppo_metrics(const MappoConfig& config, int team, const float* figures, Metrics& out);

}  // namespace giga
