// SimParams: everything about a scenario that a step reads, as plain data. Without the standard library's containers,
// so that a GPU's compiler can read it at run time; sim/spec.hpp has what owns the tables.
#pragma once

#include <bit>
#include <concepts>
#include <cstdint>
#include <type_traits>

#include "core/host_device.hpp"
#include "sim/observation.hpp"

namespace giga {

constexpr float kDt = 0.1f;              ///< seconds a step
constexpr float kAltitudeLimit = 10.0f;  ///< z lives in [0, 10], whatever the size of the map
constexpr int kEpisodeLimit = 10'000;    ///< steps of an episode where the scenario has no limit and one is needed
constexpr int kMaxAgents = 1024;         ///< agents per world that executors with tables of pairs handle
constexpr int kMaxGridAgents = 1 << 22;  ///< agents per world that the grid handles (grid.hpp)
constexpr int kMostShooters = 64;        ///< opponents whose fire at one agent is counted there (rules 17.2)
constexpr int kNTeams = 2;
constexpr int kNDiscreteActions = 27;
constexpr int kActionSize = 3;  ///< heading, dive, throttle

/// `original` reproduces the published JAX package, quirks included; `corrected` mends those listed in rules 15.
enum class Rules : uint8_t { corrected, original };
enum class ActionKind : uint8_t { discrete, continuous };

/// Terms of the reward, in the order in which they are added up. All but `idle_reward` (a property of the agent type)
/// have a weight in the scenario. Adding one: an entry here, a name below, a case in rewards.hpp.
enum class RewardTerm : int {
  hit_waypoint,
  idle_reward,
  defeat_one_opponent,
  detection,
  damage,
  idle,
  collision_agent,
  collision_obstacle,
  agent_disabled,
  game_won,
  approach,  ///< ours, as all that come behind
};
constexpr int kNRewardTerms = 11, kNOriginalRewardTerms = 10;
constexpr const char* kRewardTermNames[kNRewardTerms] = {
    "hit_waypoint",    "idle_reward",        "defeat_one_opponent", "detection", "damage",   "idle",
    "collision_agent", "collision_obstacle", "agent_disabled",      "game_won",  "approach",
};

/// By what an episode is won.
enum class WinBy : uint8_t {
  elimination,  ///< the team that is wiped out in an earlier step loses; together is a tie (rules 13.1)
  waypoints,    ///< the team that has collected more when the episode ends wins; as many is a tie
};
/// Who wins an episode that the time limit ends undecided: both teams alive, or with as many waypoints.
enum class LimitWinner : uint8_t { tie, team_0, team_1 };

/// What a win is. It is counted only: no step, reward or observation depends on it.
struct WinRule {
  WinBy by = WinBy::elimination;
  LimitWinner at_time_limit = LimitWinner::tie;
};

/// An axis-aligned obstacle, solid for z1 <= z <= z2 (only looked at with `obstacle_heights`). All zeros = no box.
struct Box {
  float x1, y1, x2, y2, z1, z2;
};
GIGA_HD Box table_box(const Box* box) {
  return {table_value(&box->x1), table_value(&box->y1), table_value(&box->x2),
          table_value(&box->y2), table_value(&box->z1), table_value(&box->z2)};
}

/// Where a team starts on a map: uniform in the area, altitude range and heading range.
struct StartArea {
  float x1, y1, x2, y2;
  float z_lo, z_hi;
  float heading_lo, heading_hi;
};

/// Per-agent constants, each array [n_agents].
struct AgentTable {
  const int32_t* sprite;      ///< bit mask of the drawn shape; also an observation
  const float* thrust;        ///< factor on acceleration
  const float* max_health;    ///< health limit
  const float* range;         ///< factor on the squared sight depth
  const float* damage_range;  ///< factor on the squared weapon depth; 0 = cannot shoot
  const float* idle_reward;   ///< reward per step for being alive
};

/// The maps of a scenario.
struct MapTable {
  const Box* boxes;           ///< [n_maps, n_boxes], padded with zero boxes
  const float* box_features;  ///< [n_maps, n_boxes * box_features(p)] the boxes as observations tell them
  const StartArea* start;     ///< [n_maps, 2], by team
  const uint8_t* pictures;    ///< [n_maps, kNPictures, picture_stride] see map_picture.hpp; null without images
  const uint16_t* paths;      ///< [n_maps, kPathGrid, kPathGrid] see paths.hpp; null = ways are straight
};

/// One world's rules and numbers. Lengths in map units, angles in radians, times in seconds unless said otherwise.
struct SimParams {
  Rules rules = Rules::corrected;
  ActionKind actions = ActionKind::discrete;

  int n_agents = 0;
  int n_team[kNTeams] = {0, 0};
  int n_maps = 1;
  int n_boxes = 0;       ///< most boxes of any map of the set; part of the observation
  int n_neighbors = 15;  ///< rows of agents in a vector observation, the ego included: min(n_agents, limit)

  float limit_x = 10, limit_y = 10;
  float inv_limit_x = 0.1f, inv_limit_y = 0.1f, inv_diagonal = 0;  ///< 1 / limit; 1 / sqrt(limit_x^2 + limit_y^2)

  uint32_t team_bits[kMaxAgents / 32] = {};  ///< bit i of word i / 32: the team of agent i, of the first kMaxAgents
  bool team_after_team = true;               ///< the agents of team 0, then those of team 1; not so in some recordings

  // Sight. Depths are squared here once.
  float very_close_depth2 = 1;
  float cone_depth2 = 9;
  float cone_cos = 0;         ///< cosine of the half angle
  bool cone_is_full = false;  ///< half angle >= pi: every direction is inside
  float damage_cone_depth2 = 0;
  float damage_cone_cos = 0;
  bool damage_cone_is_full = false;
  bool stochastic_detection = true;
  bool stochastic_communication = true;
  float communication_range = 8;

  float damage_per_second = 1;
  float healing_per_second = 0.1f;
  int min_tracking_time = 3;   ///< steps of unbroken tracking before damage starts
  int max_tracking_time = 10;  ///< steps after which damage grows no more; at most 255

  float collision_range2 = 0.16f;
  float collision_altitude = 0.5f;

  bool waypoints = false;
  float waypoint_size = 0.6f;
  float waypoint_unseen_time = 0;  ///< waypoints.shown_steps: agents see it while it stays longer than this (seconds)

  int max_episode_length = 500;  ///< steps; 0 = no limit
  bool episode_ends_one_team_dead = true;
  WinRule win;

  float reward_weight[kNRewardTerms] = {};  ///< 0 or less switches a term off; [idle_reward] is unused
  bool has_idle_reward = false;             ///< some agent type has one
  uint64_t active_terms = 0;                ///< by SimTables: the terms that are active, four bits each
  int n_active_terms = 0;
  bool has_term_factors = false;           ///< each term has a factor of its own, which may change from step to step
  bool divide_reward_by_team_size = true;  ///< by the number of all agents, as the original does

  // Beyond the original, off by default.
  bool obstacle_heights = false;       ///< boxes are solid between z1 and z2 only
  bool obstacles_block_sight = false;  ///< no detection through a box
  bool sight_3d = false;               ///< distances and cones of sight and damage use altitude too
  bool egocentric_view = false;        ///< agents can be told the egocentric view, see egocentric_view.hpp
  int resolution = 0;                  ///< pixels of a side of images; 0 = there are none
  bool images_only = false;            ///< policies are given images and no numbers
  bool mixed_teams = false;            ///< some team has agents of different sprites: the egocentric view tells kinds

  // Pointers, behind all numbers: play/spec_bytes.cpp hands these to machines whose pointers have another size.
  AgentTable agents{};
  MapTable maps{};
  const float* term_factors = nullptr;  ///< [kNRewardTerms] by SimTables, with has_term_factors: 1 at first

  GIGA_HD bool original() const { return rules == Rules::original; }
  /// Team of agent i, 0 or 1. Of a world of more than kMaxAgents agents: GridParams::team_of (grid.hpp).
  GIGA_HD int team_of(int i) const { return static_cast<int>(team_bits[i >> 5] >> (i & 31) & 1u); }
  GIGA_HD int size_of(int team) const { return team == 0 ? n_team[0] : n_team[1]; }
  /// All agents of a team lie in [first_of, end_of).
  GIGA_HD int first_of(int team) const { return team_after_team && team == 1 ? n_team[0] : 0; }
  GIGA_HD int end_of(int team) const { return team_after_team && team == 0 ? n_team[0] : n_agents; }
  /// Number of agent i inside its team: its row in the team's buffers.
  GIGA_HD int slot_of(int i) const {
    if (team_after_team) return i - first_of(team_of(i));
    int slot = 0;
    for (int k = 0; k < i; ++k) slot += team_of(k) == team_of(i) ? 1 : 0;
    return slot;
  }
  /// Where they are known to the compiler: agents of the larger team, and of both; else 0.
  static constexpr int kTeam = 0, kAgents = 0;
};

/// What the stages of a step take as parameters: SimParams, or a type in which some of its members are constants of the
/// compiler's, so that it can leave out what a scenario does not use:
///   struct FiveVsFive : SimParams { static constexpr int n_agents = 10; static constexpr bool waypoints = false; ...
///   };
template <class P>
concept Parameters = std::derived_from<P, SimParams>;

/// Calls f(agent, k) with the agents of a team in their order, k = 0, 1, ...; unrolled where their number is constant,
/// for the larger team: which of the two it is, the lanes of a warp do not agree on.
template <class F>
GIGA_HD void for_team(const Parameters auto& p, int team, F&& f) {
  using P = std::remove_cvref_t<decltype(p)>;
  if constexpr (P::kTeam > 0) {
    const int first = p.first_of(team), size = p.size_of(team);
    GIGA_UNROLL
    for (int k = 0; k < P::kTeam; ++k)
      if (P::kTeamsEqual || k < size) f(first + k, k);
  } else {
    const int end = p.end_of(team);
    int k = 0;
    for (int a = p.first_of(team); a < end; ++a)
      if (p.team_of(a) == team) f(a, k++);
  }
}

/// The lowest bit that is set, of which there is one.
GIGA_HD int lowest_bit(uint32_t bits) {
#if defined(__CUDA_ARCH__)
  return __ffs(static_cast<int>(bits)) - 1;
#else
  return std::countr_zero(bits);
#endif
}

/// How many are set.
GIGA_HD int count_bits(uint32_t bits) {
#if defined(__CUDA_ARCH__)
  return __popc(bits);
#else
  return std::popcount(bits);
#endif
}

/// Boxes of a map that a GPU reads together.
template <class P>
constexpr int kBoxesAtOnce = std::remove_cvref_t<P>::kTeam > 0 ? 4 : 1;

/// Words of 32 bits for one bit per agent.
GIGA_HD constexpr int words_for(int n_agents) { return (n_agents + 31) / 32; }

/// The bits of kAgents agents in a register, and such a row read from memory.
template <int kAgents>
using AgentBits = std::conditional_t<kAgents <= 32, uint32_t, uint64_t>;
template <int kAgents>
GIGA_HD AgentBits<kAgents> read_agent_bits(const uint32_t* row) {
  if constexpr (kAgents <= 32)
    return row[0];
  else
    return row[0] | static_cast<uint64_t>(row[1]) << 32;
}

/// The same written: the bits of a team's agents, 0 for all others.
template <class P>
GIGA_HD void write_team_bits(const P& p, int team, uint32_t* row, uint32_t bits) {
  static_assert(P::kTeam > 0 && P::kTeam <= 32 && P::kAgents <= 64);
  const auto all = static_cast<AgentBits<P::kAgents>>(bits) << p.first_of(team);
  row[0] = static_cast<uint32_t>(all);
  if constexpr (P::kAgents > 32) row[1] = static_cast<uint32_t>(all >> 32);
}

/// A row of bits, one for each agent: writes that of each agent of a team by test(agent, k), in their order, and 0 for
/// all others.
template <class Test>
GIGA_HD void write_team_bits(const Parameters auto& p, int team, uint32_t* row, Test&& test) {
  if constexpr (constexpr int kTeam = std::remove_cvref_t<decltype(p)>::kTeam; kTeam > 0) {
    uint32_t bits = 0;
    for_team(p, team, [&](int a, int k) {
      if (test(a, k)) bits |= 1u << k;
    });
    write_team_bits(p, team, row, bits);
  } else {
    const int first = p.first_of(team), end = p.end_of(team), words = words_for(p.n_agents);
    int k = 0;
    for (int word = 0; word < words; ++word) {
      uint32_t bits = 0;
      const int to = (word + 1) * 32 < end ? (word + 1) * 32 : end;
      for (int a = word * 32 > first ? word * 32 : first; a < to; ++a)
        if (p.team_of(a) == team && test(a, k++)) bits |= 1u << (a & 31);
      row[word] = bits;
    }
  }
}

}  // namespace giga
