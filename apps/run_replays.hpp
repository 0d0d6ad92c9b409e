// The replays of a run: games that are recorded while it trains, and the page that plays them.
#pragma once

#include <cstdint>
#include <exception>
#include <future>
#include <memory>

#include "eval/record.hpp"
#include "io/run_folder.hpp"
#include "learn/learner.hpp"

namespace giga {

/// Why `eval.record` games of a run are too large for a replay; empty: they are not.
std::string why_games_have_no_room(const LoadedRun& run);
/// Writes the replays of a run beside what else the program does, one at a time: the host's part of a recorded game
/// takes as long as the matches of an evaluation, during which a GPU would wait.
class ReplayWriter {
 public:
  explicit ReplayWriter(const RunFolder& folder) : folder_(folder) {}
  /// Games that were played and are finished. Waits for those before, as far as they are not written.
  void write(int64_t updates, std::unique_ptr<TeamRecording> games);
  /// Waits, and throws what went wrong.
  void wait();
  /// Waits; null, or what went wrong, for who has to save something first.
  std::exception_ptr ended();

 private:
  const RunFolder& folder_;
  std::unique_ptr<TeamRecording> games_;  // of which is written; its tensors go in the thread that made them
  std::future<void> written_;             // goes first: it waits
};

/// The page of the replays up to an update: those of the last evaluation first, then earlier ones at even distances.
/// None where there are no replays.
void write_replays_page(const RunFolder& folder, int64_t updates);

}  // namespace giga
