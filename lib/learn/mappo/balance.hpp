// Balance: what mappo changes from update to update, so that both teams go on learning: shaping that fades, the weight
// of the entropy bonus, the discount, the clip range, step sizes of each team.
#pragma once

#include <array>
#include <string>

#include "core/named_array.hpp"
#include "learn/learner.hpp"
#include "learn/mappo/config.hpp"

namespace giga {

class Balance {
 public:
  explicit Balance(const MappoConfig& config);

  /// What is left of all rewards but game_won when a share `done` of the run's updates is done.
  double shaping_factor(double done) const { return faded_to(config_.shaping_final_factor, done); }
  bool shaping_fades() const { return config_.shaping_final_factor != 1; }
  /// The same of a single reward; of game_won 1.
  double shaping_factor(RewardTerm term, double done) const;
  /// Whether single rewards fade by factors of their own.
  bool terms_fade() const { return config_.shaping_final_factors.any(); }

  /// What these are when a share `done` of the run's updates is done.
  float gamma(double done) const { return on_the_way(config_.gamma, config_.final_gamma, done); }
  float clip_coef(double done) const { return on_the_way(config_.clip_coef, config_.final_clip_coef, done); }
  float entropy_coef(int team, double done) const {
    return on_the_way(static_cast<float>(entropy_coef_[static_cast<size_t>(team)]), config_.final_entropy_coef, done);
  }
  /// A team that is far ahead learns nothing for now; its critic goes on.
  bool is_frozen(int team) const;
  /// What the step sizes of a team's actor and of its critic are multiplied with, besides the schedule.
  float actor_factor(int team) const { return is_frozen(team) ? 0.0f : critic_factor(team); }
  float critic_factor(int team) const { return config_.team_learning_rate_factors[static_cast<size_t>(team)]; }

  /// Adds the columns of what is switched on, as it was in this update.
  void add_metrics(double done, Metrics& out) const;
  /// Takes in an update: entropy_T, win_rate_0 and win_rate_1. Figures that are not known change nothing.
  void note(const Metrics& figures);

  /// What belongs to one team: the weight of its entropy bonus, where that follows a target. `in` of an older
  /// checkpoint may lack it.
  void save_team(int team, NamedArrays& out) const;
  void load_team(int team, const NamedArrays& in);

  /// Only what is switched on has a state.
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  double faded_to(float last, double done) const;
  static float on_the_way(float first, const std::optional<float>& last, double done);

  const MappoConfig config_;
  std::array<double, kNTeams> entropy_coef_;
  double lead_ = 0;  // running mean of win_rate_0 - win_rate_1
};

}  // namespace giga
