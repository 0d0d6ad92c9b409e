#include "game/team_controller.hpp"

#include "core/error.hpp"
#include "sim/image_rows.hpp"

namespace giga {
namespace {

class ScriptController final : public TeamController {
 public:
  explicit ScriptController(Scripted script) : script_(script) {}

  ObservationSet reads() const override { return observations_of(script_); }
  bool repeats() const override { return true; }
  void act(std::span<const TeamStep> parts) override {
    const std::vector<TeamStep> steps = joined(parts);
    for (size_t k = 0; k < steps.size(); ++k) {
      const TeamStep& part = steps[k];
      const ScriptedActions actions = scripted_actions(script_, part);
      if (k + 1 < steps.size() && !uses_observation(script_)) {
        const TeamStep& next = steps[++k];
        part.parallel_for.run(BlindActions{actions, scripted_actions(script_, next), part.n_rows()},
                              part.n_rows() + next.n_rows());
      } else {
        part.parallel_for.run(actions, part.n_rows());
      }
    }
  }

 private:
  const Scripted script_;
};

}  // namespace

TeamStep TeamStep::part(const WorldRange& some) const {
  GIGA_CHECK(some.first >= worlds.first && some.end() <= worlds.end(), "worlds ", some.first, " to ", some.end(),
             " of ", worlds.first, " to ", worlds.end());
  const int64_t period = sim.options().draw_period;
  GIGA_CHECK(period == 0 || some.first % period == 0 || some.first % period + some.count <= period, "worlds ",
             some.first, " to ", some.end(), ", draws have a period of ", period);
  const int64_t skipped = (some.first - worlds.first) * n();  // rows
  const bool discrete = sim.params().actions == ActionKind::discrete;
  const int64_t action_bytes = discrete ? int64_t{sizeof(int32_t)} : kActionSize * int64_t{sizeof(float)};
  const auto at = [skipped](auto* buffer, int64_t stride) { return buffer ? buffer + skipped * stride : nullptr; };
  const int64_t image = image_bytes(sim.params().resolution);
  return {sim,
          parallel_for,
          team,
          number,
          some,
          {at(buffers.obs, obs_stride()), at(buffers.image, image),
           at(static_cast<char*>(buffers.action), action_bytes), at(buffers.pre_tanh_action, kActionSize),
           at(buffers.log_prob, 1), at(buffers.memory, buffers.memory_size), buffers.memory_size},
          layout,
          behind_step};
}

TeamStep TeamStep::without_log_prob() const {
  TeamBuffers kept = buffers;
  kept.pre_tanh_action = kept.log_prob = nullptr;
  return {sim, parallel_for, team, number, worlds, kept, layout, behind_step};
}

RowDraws TeamStep::draws() const {
  const SimOptions& o = sim.options();
  const int64_t first = o.first_world + (o.draw_period > 0 ? worlds.first % o.draw_period : worlds.first);
  return {sim.state().view().draw_step + worlds.first, o.seed, first, n(), team, o.draw_period};
}

std::vector<TeamStep> joined(std::span<const TeamStep> parts) {
  std::vector<TeamStep> wide;
  for (const TeamStep& part : parts) {
    if (!wide.empty() && wide.back().team == part.team && wide.back().worlds.end() == part.worlds.first)
      wide.back().worlds.count += part.worlds.count;
    else
      wide.push_back(part);
  }
  return wide;
}

std::unique_ptr<TeamController> script_controller(Scripted script) {
  return std::make_unique<ScriptController>(script);
}

ScriptedActions scripted_actions(Scripted script, const TeamStep& step) {
  const SimParams& params = step.sim.params();
  return {script,
          params.actions,
          step.draws(),
          step.sim.state().view().episode_length + step.worlds.first,
          step.buffers.action,
          params,
          step.layout.set().has(Observation::vector) ? step.buffers.obs + step.layout.columns(Observation::vector).first
                                                     : nullptr,
          step.obs_stride()};
}

}  // namespace giga
