#include "rollout/population_games.hpp"

#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// With a limit, so that each episode ends.
SimSpec limited(const SimSpec& spec, std::optional<int> max_steps) {
  const SimSpec result = spec.with_time_limit();
  return max_steps ? result.cut_off_after(*max_steps) : result;
}

}  // namespace

PopulationGames::PopulationGames(const SimSpec& spec, const PopulationGamesOptions& options, const Actor& network,
                                 const ParallelFor& parallel_for)
    : options_(options),
      shape_{options.n_populations, options.n_members, options.n_worlds},
      fused_(takes_fused_kernel(network)),
      controller_(population_controller(shape_, network, options.greedy)) {
  SimOptions sim;
  sim.n_worlds = static_cast<int>(options.n_populations * shape_.worlds_each());
  sim.seed = options.seed;
  sim.draw_period = options.common_random_numbers ? options.n_worlds : 0;
  sim.first_world = options.common_random_numbers ? 0 : options.first_world;
  sim.on_done = OnDone::freeze;
  sim.episodes = options.n_rounds;
  sim.n_threads = options.n_threads;
  sim.compile_step = options.compile_step;
  sim.pairs = options.pairs;
  sim_ = make_simulator(limited(spec, options.max_steps), sim, parallel_for.device(), parallel_for.stream());
  const Side side = everywhere(controller_, *sim_);
  BothSides sides{side, side};
  if (options.opponent) {
    GIGA_CHECK(options.n_populations == 1, options.n_populations, " populations against one opponent");
    sides[static_cast<size_t>(options.opponent_team)] = everywhere(options.opponent, *sim_);
  }
  game_ = std::make_unique<Game>(*sim_, parallel_for, sides);
}

uint32_t PopulationGames::draw_steps() const {
  return static_cast<uint32_t>(int64_t{options_.n_rounds} * (sim_->params().max_episode_length + 2));
}

void PopulationGames::play(const std::vector<Population>& populations, uint32_t first_step) {
  at::NoGradGuard no_grad;
  GIGA_CHECK(!options_.opponent || populations.at(0).team != options_.opponent_team, "team ", options_.opponent_team,
             " is both a population and its opponent");
  controller_->begin(populations);
  wrap(reinterpret_cast<int32_t*>(sim_->state().view().draw_step), {sim_->n_worlds()}, sim_->device())
      .fill_(static_cast<int64_t>(static_cast<int32_t>(first_step)));
  game_->start();
  game_->play(int64_t{options_.n_rounds} * sim_->params().max_episode_length);
  controller_->end();
}

at::Tensor PopulationGames::results(size_t k) const {
  const at::Tensor all = wrap(sim_->state().view().stats, {sim_->n_worlds(), kNStatRows}, sim_->device());
  const WorldRange worlds = shape_.worlds(k);
  return all.narrow(0, worlds.first, worlds.count).view({options_.n_members, options_.n_worlds, kNStatRows});
}

}  // namespace giga
