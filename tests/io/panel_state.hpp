// A run in the middle, as panels in tests show it.
#pragma once

#include <array>

#include "io/progress.hpp"

namespace giga::test {

inline std::vector<TeamFigure> learner_figures(const std::array<double, 5>& values) {
  return {{"policy loss", "", values[0]},
          {"value loss", "value loss", values[1]},
          {"entropy", "entropy", values[2]},
          {"approximate KL", "approx. KL", values[3]},
          {"expl. variance", "", values[4]}};
}

inline ProgressState run_at(int64_t update) {
  ProgressState s;
  s.title = "identical_5_vs_5, mappo, seed 1, cuda:0 (NVIDIA H200)";
  s.folder = "runs/identical_5_vs_5-mappo-seed1-001";
  s.update = update;
  s.n_updates = 200;
  s.agent_steps = update * 1'500'000;
  s.total_agent_steps = 300'000'000;
  s.seconds = 1.5 * static_cast<double>(update);
  s.seconds_left = 1.5 * static_cast<double>(200 - update);
  s.agent_steps_per_second = 1e6;
  s.time = {0.5 * s.seconds, 0.25 * s.seconds, 0.05 * s.seconds, 0.2 * s.seconds};
  s.team[0] = {true, 12.34, {{"random", 0.98}, {"circle", 0.4}}, {}};
  s.team[1] = {true, -3.5, {{"random", 0.97}, {"circle", 0.31}}, {}};
  s.team[0].figures = learner_figures({-0.0123, 0.25, 1.5, 0.01, 0.875});
  s.team[1].figures = learner_figures({-0.02, 0.5, 1.25, 0.02, 0.75});
  s.memory_used = int64_t{12} << 30;
  s.memory_total = int64_t{139} << 30;
  s.gpu_temperature = 41;
  return s;
}

}  // namespace giga::test
