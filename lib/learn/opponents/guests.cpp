#include "learn/opponents/guests.hpp"

#include <ATen/ATen.h>

#include <string>
#include <vector>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "learn/players/player.hpp"
#include "rollout/group_policy.hpp"

namespace giga {
namespace {

PolicySettings settings_of(const LoadedRun& run) { return algorithm_of(run.config).policy(run.config); }

/// In what two networks differ besides how they began; empty = in nothing.
std::string difference(ActorConfig theirs, ActorConfig ours) {
  theirs.hidden_gain = ours.hidden_gain;
  theirs.output_gain = ours.output_gain;
  theirs.log_std_init = ours.log_std_init;
  theirs.log_std_min = ours.log_std_min;
  theirs.log_std_max = ours.log_std_max;
  const std::vector<FieldInfo> there = list_fields(fields_of(theirs)), here = list_fields(fields_of(ours));
  std::string text;
  for (size_t k = 0; k < there.size(); ++k)
    if (there[k].default_value != here[k].default_value)
      text += cat(text.empty() ? "" : ", ", there[k].path, " is ", there[k].default_value, " there and ",
                  here[k].default_value, " here");
  return text;
}

void check_alike(const LoadedRun& theirs, const LoadedRun& ours) {
  const PolicySettings there = settings_of(theirs), here = settings_of(ours);
  const std::string text = difference(there.actor, here.actor);
  if (!text.empty()) throw InputError(cat("its networks are not like those of the run: ", text));
  if (there.obs_norm != here.obs_norm)
    throw InputError(cat("its networks are not like those of the run: observations are ",
                         there.obs_norm ? "normalised there and not here" : "normalised here and not there"));
  if (there.greedy && !here.greedy)
    throw InputError("it takes its most likely actions, and those of the pool are drawn");
}

}  // namespace

std::array<at::Tensor, kNTeams> load_guests(const LoadedRun& run, const std::array<const Actor*, kNTeams>& actors,
                                            Device device) {
  std::array<std::vector<at::Tensor>, kNTeams> rows;
  for (const std::string& name : run.config.opponents.policies) {
    try {
      const Player player = Player::load(name, {.device = device});
      player.check_plays(run.spec, &run.scenario);
      bool some = false;
      for (int team = 0; team < kNTeams; ++team) {
        const auto* actor = dynamic_cast<const Actor*>(player.mind(team, run.spec).policy);
        if (!actor) continue;
        some = true;
        check_alike(player.origin()->run, run);
        rows[static_cast<size_t>(team)].push_back(GroupPolicy::row_of(*actor));
        if (rows[static_cast<size_t>(team)].back().numel() !=
            GroupPolicy::row_of(*actors[static_cast<size_t>(team)]).numel())
          throw InputError(
              "its networks read other numbers than those of this run: were its agents given the egocentric view "
              "(environment.observation.egocentric_view) as these are?");
      }
      if (!some) throw InputError("only runs and checkpoints have networks that can join the pool");
    } catch (const InputError& e) {
      Errors errors;
      errors.add(run.policies_at.value_or(Position{}), cat("opponents.policies: ", name, ": ", e.what()));
      throw InputError(errors.text());
    }
  }
  std::array<at::Tensor, kNTeams> guests;
  for (size_t team = 0; team < kNTeams; ++team)
    if (!rows[team].empty()) guests[team] = at::stack(rows[team]);
  return guests;
}

}  // namespace giga
