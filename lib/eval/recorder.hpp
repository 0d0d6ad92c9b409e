// Recorder: watches a match and keeps its games as episodes of a replay.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/memory.hpp"
#include "eval/recorded_world.hpp"
#include "game/game.hpp"
#include "io/replay.hpp"
#include "learn/players/mind.hpp"
#include "sim/spec.hpp"

namespace giga {

struct RecorderOptions {
  int worlds = 0;                           ///< the last ones of the simulator; 0 = all
  int64_t most_bytes = int64_t{128} << 20;  ///< that wait on the device; at least kListPeriod states do
};

/// Keeps the episodes of worlds of a match (OnDone::freeze, one episode). What it keeps of a step stays on the device
/// until the match is over or there is no more room, so that neither waits for the other. The networks are asked again:
/// who plays need not tell what it thought.
class Recorder final : public GameObserver {
 public:
  /// The networks must outlive it.
  explicit Recorder(const SimSpec& spec, const Minds& minds = {}, const RecorderOptions& options = {});
  ~Recorder() override;

  bool needs_tables() const override { return true; }  // replays keep them
  void before_step(int64_t t, GameStep& step) override;
  void after_step(int64_t t, const GameStep& step) override;
  /// Unless the networks remember: those are asked of each state at once.
  bool repeats() const override;
  void record_step(int k, const GameStep& step) override;
  void after_recorded(const GameStep& step) override;

  /// After the match: asks the networks of what is left, fetches it, and keeps nothing on the device. What follows is
  /// the host's work alone: it asks no network and runs no kernel, so any thread may do it.
  void finish();
  /// For who measures memory: as if as many states waited as there is room for. Then `finish`, and nothing else.
  void fill();
  /// The episodes of the worlds, in their order. `seed`: of the simulator, as in Replay.
  std::vector<ReplayEpisode> episodes(const std::string& seed);

 private:
  struct Remembered;
  struct Kept;
  struct Fetched;

  bool over() const;
  int64_t first_world(const Simulator& sim) const;
  void make_rooms(const GameStep& step);
  void keep(const GameStep& step, Kept& to, int64_t at) const;
  void make_room(int64_t states);
  void fetch();
  void ask(Fetched& to);
  void note();
  void note_actions(const uint8_t* const (&actions)[kNTeams]);
  void note_state(const uint8_t* bytes);
  void note_minds(const std::vector<int>& states);

  const SimSpec spec_;
  const Minds minds_;
  const RecorderOptions options_;
  std::vector<RecordedWorld> worlds_;
  Buffer<float> true_state_;  // [all worlds, G] where a critic reads it
  std::unique_ptr<Remembered> remembered_;
  std::unique_ptr<Kept> waiting_, recorded_;  // states that are not fetched yet; those of steps that are recorded
  std::unique_ptr<Fetched> fetched_;          // not noted yet
  int64_t noted_ = 0;                         // states that were
};

}  // namespace giga
