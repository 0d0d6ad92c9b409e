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

  /// Before a rollout: the opponents that are met in it.
  void begin();
  /// After a rollout: queues the sums of the simulator's statistics, over all ranks.
  void count(const Simulator& sim);
  /// Reads them and waits for the device: statistics of the worlds in which both teams learn, and the record of each
  /// team. A game against a past policy counts if it began after that opponent was drawn.
  void read(EpisodeStats& self_play, std::array<LeagueRecord, kNTeams>& record);
  /// After `read`: if an update with this number calls for it, keeps the policies (pool_promotion) and draws new
  /// opponents. A game in progress goes on against the new ones, who remember nothing of it. Whether it did.
  bool end(int64_t updates_done, const Simulator& sim);
  /// Where past policies of a team play.
  ShardRange pool_worlds(int team) const { return shares_.pool(1 - team); }

  /// What there is of each world of this process; to be loaded before the rest.
  void save_worlds(const std::string& prefix, NamedArrays& out) const;
  void load_worlds(const std::string& prefix, const NamedArrays& in);
  /// No game that is on counts: whom its world meets has changed.
  void forget_games() { counts_.zero_(); }
  /// What all ranks have alike.
  void save(const std::string& prefix, NamedArrays& out) const;
  /// Whether worlds meet others than when it was saved (opponents.policies have changed), who remember nothing.
  bool load(const std::string& prefix, const NamedArrays& in);

 private:
  /// A team's past policies, which the other team meets.
  struct Past {
    const Actor* actor;
    OpponentPool pool;
    GroupPolicy policy;
    GameCount since_kept;      // of this team against the other's pool
    std::vector<int32_t> row;  // of the pool, by group; there may be more than there are groups
    at::Tensor row_index;      // [groups] the same on the device
    at::Tensor networks;       // [groups, row size] of `policy`, which stay where they are
  };
  void set_rows(Past& past, std::vector<int32_t> rows) const;
  void draw_rows(int team, uint32_t update);
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
  at::Tensor sums_;  // statistics of self-play, then of each team: groups, scripts; see count
};

}  // namespace giga
