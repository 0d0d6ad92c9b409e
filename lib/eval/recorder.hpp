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

/// Keeps the episode of each world of a match (OnDone::freeze, one episode). What it keeps of a step stays on the
/// device until there are many: the match does not wait for the host at each step. The networks are asked again: who
/// plays need not tell what it thought.
class Recorder final : public GameObserver {
 public:
  /// The networks must outlive it.
  explicit Recorder(const SimSpec& spec, const Minds& minds = {});
  ~Recorder() override;

  void before_step(int64_t t, GameStep& step) override;
  void after_step(int64_t t, const GameStep& step) override;

  /// After the match: the episodes of worlds 0, 1, ... `seed`: of the simulator, as in Replay.
  std::vector<ReplayEpisode> episodes(const std::string& seed);

 private:
  struct Remembered;
  struct Waiting;

  bool over() const;
  void make_room(const GameStep& step);
  void put_off(const GameStep& step);
  void note();
  void note_actions(const uint8_t* const (&actions)[kNTeams]);
  void note_state(const uint8_t* bytes);
  void ask_minds();

  const SimSpec spec_;
  const Minds minds_;
  std::vector<RecordedWorld> worlds_;
  Buffer<float> true_state_;  // [W, G] where a critic reads it
  std::unique_ptr<Remembered> remembered_;
  std::unique_ptr<Waiting> waiting_;
};

}  // namespace giga
