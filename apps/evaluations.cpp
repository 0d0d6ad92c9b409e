#include "apps/evaluations.hpp"

#include <memory>
#include <utility>

#include "core/error.hpp"
#include "eval/record.hpp"

namespace giga {

void Evaluations::play(Learner& learner) {
  MatchOptions options = evaluation_options(run_, device_, learner);
  options.note = [this](const std::string& text) {
    if (std::exchange(note_, text) != text) log_.note(text);
  };
  const int kept = run_.config.eval.record;
  std::unique_ptr<TeamRecording> games;
  if (kept > 0) {
    if (!no_room_for_games_) no_room_for_games_ = why_games_have_no_room(run_);
    if (no_room_for_games_->empty())
      games = std::make_unique<TeamRecording>(run_, learner, kept, options);
    else
      log_.note(cat("no games are kept (eval.record: ", kept, "): ", *no_room_for_games_));
  }
  results_ = evaluate(run_, options, learner, games ? &games->games() : nullptr);
  if (!games) return;
  games->finish();
  replays_.write(learner.updates_done(), std::move(games));
}

}  // namespace giga
