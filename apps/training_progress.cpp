#include "apps/training_progress.hpp"

#include <algorithm>
#include <limits>
#include <string>

#include "cuda/runtime.hpp"

namespace giga {
namespace {

double value_of(const Metrics& metrics, const std::string& name) {
  for (const auto& [key, value] : metrics)
    if (key == name) return value;
  return std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

TrainingProgress::TrainingProgress(const LoadedRun& run, Device device, const RunFolder& folder,
                                   std::optional<int64_t> n_updates, Progress& progress)
    : progress_(progress) {
  const RunConfig& config = run.config;
  state_.title = cat(config.scenario, ", ", config.train.algorithm, ", seed ", config.seed, ", ", device.name());
  if (device.is_cuda()) {
    sensors_.emplace(device.index);
    state_.title += cat(" (", cuda_device_info(device.index).name, ")");
  }
  state_.folder = folder.path().string();
  state_.n_updates = n_updates.value_or(0);
  state_.total_agent_steps = config.train.total_agent_steps;
  if (const auto per_update = algorithm_of(config).agent_steps_per_update)
    state_.total_agent_steps = *n_updates * per_update(config, run.spec.params.n_agents);
}

void TrainingProgress::show(Learner& learner, const UpdateFigures& figures, int64_t first_agent_steps) {
  ProgressState& s = state_;
  const UpdateTimes times = learner.times();
  s.time.rollout += times.rollout;
  s.time.update += times.learning;
  s.time.evaluation += figures.evaluation_seconds;
  s.time.rest = watch_.seconds() - s.time.rollout - s.time.update - s.time.evaluation;
  const double speed = figures.agent_steps_per_second;
  s.agent_steps_per_second = s.agent_steps_per_second > 0 ? 0.9 * s.agent_steps_per_second + 0.1 * speed : speed;
  s.update = learner.updates_done();
  s.agent_steps = learner.agent_steps_done();
  s.seconds = figures.seconds;
  s.seconds_left = watch_.seconds() / static_cast<double>(s.agent_steps - first_agent_steps) *
                   static_cast<double>(std::max<int64_t>(0, s.total_agent_steps - s.agent_steps));
  for (int team = 0; team < kNTeams; ++team) {
    const auto figure = [&](const char* name) { return value_of(figures.metrics, cat(name, "_", team)); };
    TeamProgress& t = s.team[team];
    t.learns = learner.actor(team) != nullptr;
    t.mean_return = figure("return");
    t.figures.clear();
    for (const HeadlineFigure& f : learner.headline())
      t.figures.push_back({f.label, f.short_label ? f.short_label : "", figure(f.metric)});
    t.win_rates.clear();
    for (const TeamResult& r : figures.results)
      if (r.team == team) t.win_rates.emplace_back(r.opponent, r.share(r.wins()));
  }
  read_sensors();
  progress_.show(s);
}

/// Once a second.
void TrainingProgress::read_sensors() {
  if (!sensors_ || (sensors_read_at_ >= 0 && watch_.seconds() - sensors_read_at_ <= 1)) return;
  const GpuReading gpu = sensors_->read();
  state_.memory_used = gpu.memory_used;
  state_.memory_total = gpu.memory_total;
  state_.gpu_temperature = gpu.temperature;
  sensors_read_at_ = watch_.seconds();
}

}  // namespace giga
