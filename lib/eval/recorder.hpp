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
#include "sim/params.hpp"

namespace giga {

/// Keeps the episode of each world of a match (OnDone::freeze, one episode). The networks are asked again: who plays
/// need not tell what it thought.
class Recorder final : public GameObserver {
 public:
  /// The networks must outlive it.
  explicit Recorder(const SimSpec& spec, const Minds& minds = {});
  ~Recorder() override;

  void before_step(int64_t t, GameStep& step) override;
  void after_step(int64_t t, const GameStep& step) override;

  /// After the match: the episodes of worlds 0, 1, ... `seed`: of the simulator, as in Replay.
  std::vector<ReplayEpisode> episodes(const std::string& seed) const;

 private:
  struct Remembered;
  struct Waiting;

  void read_state(const Simulator& sim);
  WorldView view_of(size_t world) const;
  RecordedLists lists_of(const Simulator& sim, size_t world) const;
  void note_actions(const GameStep& step);
  void make_room(const GameStep& step);
  void put_off(const GameStep& step);
  void ask_minds();

  const SimSpec spec_;
  const Minds minds_;
  std::vector<RecordedWorld> worlds_;
  std::vector<uint8_t> bytes_;  // the state of all worlds, on the host
  StateView state_{};           // its fields; those of pairs are null in a crowd
  PairLists lists_;             // of a crowd
  Buffer<float> true_state_;    // [W, G] where a critic reads it
  std::unique_ptr<Remembered> remembered_;
  std::unique_ptr<Waiting> waiting_;
};

}  // namespace giga
