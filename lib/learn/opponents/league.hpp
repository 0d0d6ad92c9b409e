// League: the frozen opponents of mappo. It seats controllers, draws past policies, and counts how the learning teams
// do against them and against scripts.
#pragma once

#include <torch/types.h>

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "game/game.hpp"
#include "learn/opponents/pool.hpp"
#include "learn/opponents/record.hpp"
#include "learn/opponents/world_shares.hpp"
#include "policy/sum_over_ranks.hpp"
#include "rollout/group_policy.hpp"

namespace giga {

class League {
 public:
  /// Of a run in which both teams learn; the actors must outlive this. `worlds`: of this process; `sum`: over all
  /// ranks, each of which has a league with as many.
  League(const LoadedRun& run, const WorldShares& worlds, std::array<const Actor*, kNTeams> actors,
         const ParallelFor& parallel_for, const SumOverRanks& sum = {});

  /// Who moves a team: its actor where it learns; where it does not, scripts or past policies of its own. This must
  /// outlive them.
  Side side(int team) const;

  /// Before a rollout: where there are no past policies yet, the other team as it is now is met.
  void begin();
  /// After a rollout: queues the sums of the simulator's statistics, over all ranks, and which games go on that began
  /// before their opponents were drawn.
  void count(const Simulator& sim);
  /// Reads them and waits for the device: statistics of the worlds in which both teams learn, and the record of each
  /// team. A game against a past policy counts if it began after that opponent was drawn and ended before the next one
  /// was.
  void read(EpisodeStats& self_play, std::array<LeagueRecord, kNTeams>& record);
  /// After `read`: if an update with this number calls for it, keeps the policies (pool_promotion) and draws new
  /// opponents, which the next games are against: one that is on goes on against the opponent that it began with. Only
  /// two generations are there at a time, so a group in which a game of the earlier one still goes on, in any shard of
  /// any rank, keeps its opponent until the next turn. Of a team that has `fallen` back to what it was at an
  /// earlier turn (mappo.step_back) nothing is kept now: its policy of then is there already.
  void end(int64_t updates_done, const Simulator& sim, const std::array<bool, kNTeams>& fallen = {});
  /// Where past policies of a team play.
  ShardRange pool_worlds(int team) const { return shares_.pool(1 - team); }

  /// What there is of each world of this process; to be loaded before the rest.
  void save_worlds(const std::string& prefix, NamedArrays& out) const;
  void load_worlds(const std::string& prefix, const NamedArrays& in, const Simulator& sim);
  /// No game that is on counts, nor has an earlier opponent: whom its world meets has changed.
  void forget_games(const Simulator& sim);
  /// What all ranks have alike.
  void save(const std::string& prefix, NamedArrays& out) const;
  /// Whether worlds meet others than when it was saved (opponents.policies have changed), who remember nothing: then
  /// games are to be forgotten.
  bool load(const std::string& prefix, const NamedArrays& in);

 private:
  /// A team's past policies, which the other team meets. G: of a fixed number of groups, which may be more than there
  /// are, so that a run may go on with other shares.
  struct Past {
    const Actor* actor;
    OpponentPool pool;
    TwoGenerations policies;
    GameCount since_kept = {};        // of this team against the other's pool
    std::vector<int32_t> row = {};    // [G] of the pool, by group; kGone
    std::vector<uint8_t> waits = {};  // [G] the earlier opponent still plays, so that none is drawn
    at::Tensor networks = {};         // [2, G, row size] of `policies`, which stay where they are: now, earlier
    at::Tensor present = {};          // the groups whose row is 0
  };
  void set_rows(Past& past, std::vector<int32_t> rows) const;
  void draw_rows(int team, uint32_t update);
  void take_networks(Past& past, const std::vector<int64_t>& groups) const;
  void begin_games(int team, const Simulator& sim);
  void note_earlier(const Simulator& sim);
  void set_any_plays(bool any);
  at::Tensor by_group(const at::Tensor& of_worlds, int team) const;
  bool is_promoted(size_t team) const;
  at::Tensor counts_of(const at::Tensor& stats, const ShardRange& worlds, int team) const;

  const OpponentsConfig config_;
  const bool guests_are_saved_;
  const uint64_t seed_;
  const at::Device device_;
  const WorldShares shares_;
  const SumOverRanks sum_;
  const std::shared_ptr<TeamController> learners_;  // of both teams
  std::vector<Past> past_;                          // by team; empty without a pool
  at::Tensor counts_;                               // [W] 1: the game that is on began after its opponent was drawn
  at::Tensor drawn_at_;                             // [W] see TwoGenerations
  at::Tensor earlier_;                              // [W] uint8: the game that is on is against the earlier opponent
  at::Tensor sums_;  // statistics of self-play, then of each team: groups, where the earlier one plays, scripts
};

}  // namespace giga
