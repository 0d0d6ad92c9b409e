// InformationMeter: watches a match and measures how much what learned teams do depends on what they see and remember.
#pragma once

#include <array>
#include <memory>
#include <optional>

#include "game/game.hpp"
#include "learn/players/mind.hpp"
#include "sim/spec.hpp"

namespace giga {

/// The mutual information of observation and action over all steps of living agents of a match (OnDone::freeze, one
/// episode). The policies are asked again: who plays need not tell what it thought.
class InformationMeter final : public GameObserver {
 public:
  /// `spec`: of the game. The policies must outlive it; sides without one are not measured.
  InformationMeter(const SimSpec& spec, const Minds& minds);
  ~InformationMeter() override;

  void before_step(int64_t t, GameStep& step) override;
  void after_step(int64_t t, const GameStep& step) override;

  /// In nats (policy/mutual_information.hpp), by side, of the steps of the match so far.
  std::array<std::optional<double>, kNTeams> nats() const;

 private:
  struct Side;

  const int64_t stride_;  // of a row of observations
  const Minds minds_;
  std::array<std::unique_ptr<Side>, kNTeams> sides_;
};

}  // namespace giga
