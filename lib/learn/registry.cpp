// The only list of algorithm names.
#include "core/error.hpp"
#include "learn/evolution/evolution.hpp"
#include "learn/learner.hpp"
#include "learn/mappo/mappo.hpp"

namespace giga {

std::unique_ptr<Learner> make_learner(const LoadedRun& run, Device device) {
  const std::string& name = run.config.train.algorithm;
  if (name == "mappo") return make_mappo(run, device);
  if (name == "openai_es" || name == "snes" || name == "des") return make_evolution(run, device);
  throw InputError(cat("train.algorithm: '", name, "' is unknown; allowed: mappo, openai_es, snes, des"));
}

}  // namespace giga
