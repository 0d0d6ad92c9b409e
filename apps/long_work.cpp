#include "apps/long_work.hpp"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <string_view>

#include "apps/stop_request.hpp"
#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {

double LongWork::run(const std::function<void()>& f, bool evaluates) {
  watch_ = Stopwatch();
  learning_began_ = -1;
  update_ = learner_.updates_done() + 1;
  evaluates_ = evaluates;
  struct OthersTurn {
    std::unique_lock<std::mutex>& ours;
    explicit OthersTurn(std::unique_lock<std::mutex>& lock) : ours(lock) { ours.unlock(); }
    ~OthersTurn() { ours.lock(); }
  };
  const Stopwatch watch;  // watch_ is read by the watcher meanwhile
  const OthersTurn turn(our_turn_);
  f();
  return watch.seconds();
}

/// "playing, step 12 of 32".
std::string LongWork::stage_text() const {
  const UpdateStage stage = learner_.stage();
  return stage.of > 0 ? cat(stage.doing, " ", stage.done, " of ", stage.of) : stage.doing;
}

/// ", about 20 s": what the last update or evaluation took, less what this one has; of a first update what its stage
/// says, of a first evaluation nothing.
std::string LongWork::time_left() const {
  const auto text = [](double seconds, const char* behind) {
    const double whole = std::max(1.0, std::round(seconds));
    return cat(", about ", whole < 60 ? cat(whole, " s") : print_duration(whole), behind);
  };
  const double now = watch_.seconds();
  if (evaluates_) return last_evaluation_seconds_ > 0 ? text(last_evaluation_seconds_ - now, "") : "";
  if (last_update_seconds_ > 0) return text(last_update_seconds_ - now, "");
  const UpdateStage stage = learner_.stage();
  if (stage.of == 0 || stage.done == 0) return cat(" (", stage_text(), ")");
  const double of_stage = now - std::max(learning_began_, 0.0);
  const double left = of_stage * static_cast<double>(stage.of - stage.done) / static_cast<double>(stage.done);
  return text(left, learning_began_ >= 0 ? "" : " and the learning behind it");
}

void LongWork::look() {
  const std::unique_lock turn(messages_, std::try_to_lock);
  if (!turn) return;
  if (learning_began_ < 0 && std::string_view(learner_.stage().doing).starts_with("learning"))
    learning_began_ = watch_.seconds();
  if (const int signal = StopRequest::signal(); signal != 0 && !answered_) {
    answered_ = true;
    const std::string what = evaluates_ ? "finishing the evaluation" : cat("finishing update ", update_);
    log_.answer(what + time_left() + (signal == SIGINT ? "; Ctrl-C again ends without saving" : ""));
  }
  constexpr double kPatience = 1;
  if (last_update_seconds_ > 0 || evaluates_ || watch_.seconds() < kPatience) return;
  progress_.wait_line(
      cat("update ", update_, of_updates_, ": ", stage_text(), ", for ", print_duration(watch_.seconds())));
}

}  // namespace giga
