// What a training run says while an update or an evaluation goes on: how far it is, and an answer to who asks it to
// stop.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <string>

#include "apps/stopwatch.hpp"
#include "io/logger.hpp"
#include "io/progress.hpp"
#include "learn/learner.hpp"

namespace giga {

/// Work of the main thread, during which a watcher may write messages: at other times these are the main thread's.
class LongWork {
 public:
  /// `of_updates`: " of 50", where their number is known.
  LongWork(const Learner& learner, std::string of_updates, Logger& log, Progress& progress)
      : learner_(learner), of_updates_(std::move(of_updates)), log_(log), progress_(progress) {}

  /// Both run `f` and give its seconds.
  double update(const std::function<void()>& f) { return last_update_seconds_ = run(f, false); }
  double evaluation(const std::function<void()>& f) { return last_evaluation_seconds_ = run(f, true); }

  /// The watcher's, from its own thread: answers a request to stop, and shows how the first update of this process goes
  /// on.
  void look();

 private:
  double run(const std::function<void()>& f, bool evaluates);
  std::string stage_text() const;
  std::string time_left() const;

  const Learner& learner_;
  const std::string of_updates_;
  Logger& log_;
  Progress& progress_;
  std::mutex messages_;
  std::unique_lock<std::mutex> our_turn_{messages_};
  // Written while it is our turn:
  Stopwatch watch_;                     // since the work began
  double learning_began_ = -1;          // then; not yet: -1
  double last_update_seconds_ = 0;      // 0: this process has done none
  double last_evaluation_seconds_ = 0;  // likewise
  int64_t update_ = 0;                  // its number
  bool evaluates_ = false;
  bool answered_ = false;  // the request to stop
};

}  // namespace giga
