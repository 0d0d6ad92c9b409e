// PopulationController: moves teams while populations play, every world by a network or a script of its own.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "game/team_controller.hpp"
#include "math/population_actions.hpp"
#include "policy/actor.hpp"

namespace giga {

/// One team's population and whom it meets, which means nothing where another controller moves the opponents. M =
/// members, P = parameters of a network, E = worlds of a member.
struct Population {
  int team = 0;
  at::Tensor members;             // [M, P]
  at::Tensor opponents;           // [K, P] networks of the other team
  std::vector<int32_t> opponent;  // [E] row of `opponents`, or a script (network_of_script)
};

/// Which worlds are whose: population k has those from k M E on, member m of it E of these.
struct PopulationShape {
  int n_populations = 2;
  int64_t n_members = 512, n_worlds = 16;

  int64_t worlds_each() const { return n_members * n_worlds; }
  WorldRange worlds(size_t k) const { return {static_cast<int64_t>(k) * worlds_each(), worlds_each()}; }
};

class PopulationController : public TeamController {
 public:
  /// Who plays until `end`; `populations` is as many as the shape says.
  void begin(const std::vector<Population>& populations);
  /// Lets go of them.
  void end();

  ObservationSet reads() const override;
  void reads_by_world(int team, int64_t first, std::span<uint8_t> sets) const override;
  int64_t memory_size() const override { return network_.state_size(); }
  /// `teams`: both in all worlds, or the one of the only population, where another controller moves its opponents.
  void act(std::span<const TeamStep> teams) override;
  /// Networks and scripts.
  int n_shares() const override { return 2; }
  void act_share(int share, std::span<const TeamStep> teams) override;

 protected:
  PopulationController(const PopulationShape& shape, const Actor& network, bool greedy);

  virtual void take() = 0;
  virtual void drop() = 0;
  virtual void move_networks(std::span<const TeamStep> teams) = 0;

  /// The step of one of `teams`; null: another controller moves it.
  static const TeamStep* step_of(int team, std::span<const TeamStep> teams);
  /// How heads of networks become actions.
  PopulationAct actions_of(const TeamStep& step) const;
  const int32_t* opponents_of(size_t k) const {
    return opponent_.const_data_ptr<int32_t>() + static_cast<int64_t>(k) * shape_.n_worlds;
  }

  const PopulationShape shape_;
  const Actor& network_;
  const bool greedy_;
  std::vector<Population> populations_;
  at::Tensor opponent_;              // [n_populations, E] int32
  at::Tensor scripted_;              // [n_populations, E] int32: the episodes whose opponents are scripts, first
  std::vector<int64_t> n_scripted_;  // [n_populations] how many

 private:
  void move_scripts(std::span<const TeamStep> teams) const;
};

/// The networks are those of `network`'s shape and arithmetic: on a GPU those in fp16 are computed by the fused kernel,
/// which must have room for them, all others by LibTorch. `network` must outlive the controller.
std::unique_ptr<PopulationController> population_controller(const PopulationShape& shape, const Actor& network,
                                                            bool greedy);
/// Whether that takes the fused kernel.
bool takes_fused_kernel(const Actor& network);

}  // namespace giga
