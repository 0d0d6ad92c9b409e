// Worlds of many agents: a uniform grid of cells over the places of the agents that live, by which pairs are found
// (rules 17). GridParams and GridWorld are the parameters and the world that the stages of step.hpp then work on; what
// the stages that look at pairs do for them stands in grid_stages.hpp.
#pragma once

#include <cmath>
#include <concepts>

#include "core/geometry.hpp"
#include "sim/crew.hpp"
#include "sim/draws.hpp"
#include "sim/movement.hpp"
#include "sim/params.hpp"
#include "sim/reset.hpp"
#include "sim/world.hpp"

namespace giga {

/// Of those that detect an agent so many are kept for who looks for it; where there are more, all are found again if
/// none of these is heard.
constexpr int kKeptDetectors = 16;
/// Most of n_step_items (episode.hpp).
constexpr int kMostStepItems = kNTeams + kNTeams * kNRewardTerms;
/// See GridWorld::place.
constexpr int32_t kNotPlaced = -1;

/// An entry of the list of fire at an agent: number of the shooter, above it its counter. 0 = none.
constexpr int kShooterBits = 24;
static_assert(kMaxGridAgents <= 1 << kShooterBits);
GIGA_HD uint32_t fire_entry(int shooter, int count) {
  return static_cast<uint32_t>(count) << kShooterBits | static_cast<uint32_t>(shooter);
}
GIGA_HD int shooter_of(uint32_t entry) { return static_cast<int>(entry & ((1u << kShooterBits) - 1u)); }
GIGA_HD int count_of(uint32_t entry) { return static_cast<int>(entry >> kShooterBits); }

/// A range of the agents sorted by cell.
struct CellRange {
  int32_t begin, end;
};

/// Cells over a rectangle, row after row along x.
struct GridShape {
  int columns = 1, rows = 1;
  float x0 = 0, y0 = 0;          // corner of the rectangle
  float size_x = 1, size_y = 1;  // of a cell
  float inverse_size_x = 0, inverse_size_y = 0;

  GIGA_HD int cells() const { return columns * rows; }
  GIGA_HD int column(float x) const { return cell((x - x0) * inverse_size_x, columns); }
  GIGA_HD int row(float y) const { return cell((y - y0) * inverse_size_y, rows); }
  GIGA_HD int cell_of(float x, float y) const { return row(y) * columns + column(x); }

 private:
  /// What lies outside counts to the outermost cell: the dead stay where they left the map.
  GIGA_HD static int cell(float at, int n) {
    if (!(at > 0)) return 0;
    return at < static_cast<float>(n) ? static_cast<int>(at) : n - 1;
  }
};

/// About one cell for each of `n` agents that lie in a rectangle; never more than `n`.
GIGA_HD GridShape grid_shape(int n, float x0, float y0, float x1, float y1) {
  GridShape g;
  if (n < 1) return g;
  g.x0 = x0;
  g.y0 = y0;
  const float width = max_of(x1 - x0, 1e-3f), height = max_of(y1 - y0, 1e-3f);
  const float side = std::sqrt(width / static_cast<float>(n) * height);
  const auto count = [&](float length, int most) {
    const float k = length / side;
    return k >= static_cast<float>(most) ? most : (k > 1 ? static_cast<int>(k) : 1);
  };
  g.columns = count(width, n);
  g.rows = count(height, n / g.columns);
  g.size_x = width / static_cast<float>(g.columns);
  g.size_y = height / static_cast<float>(g.rows);
  g.inverse_size_x = 1.0f / g.size_x;
  g.inverse_size_y = 1.0f / g.size_y;
  return g;
}

/// Cells in which the dead of a world are sorted, where many workers do it: one for some of its agents.
constexpr int kDeadOfCell = 4;
GIGA_HD int cells_of_dead(int n_agents) { return (n_agents + kDeadOfCell - 1) / kDeadOfCell; }

/// SimParams of any number of agents, and how far pairs reach. Distances are in the plane and a little more than what
/// the formulas compare, so that rounding leaves nobody out.
struct GridParams : SimParams {
  int most_shooters = kMostShooters;  ///< of a list of fire
  float sight_reach[kNTeams] = {};    ///< at which an agent of the team detects at most
  float hearing_reach = 0, touch_reach = 0, start_reach = 0;
  float margin = 0;   ///< of places: more than what float32 may round
  GridShape of_dead;  ///< cells in which many workers sort the dead

  GridParams() = default;
  /// `widest_range`: by team, the largest AgentTable::range.
  GridParams(const SimParams& p, const float (&widest_range)[kNTeams], int shooters) : SimParams(p) {
    constexpr float kMore = 1.0001f;
    const int most = n_team[0] > n_team[1] ? n_team[0] : n_team[1];
    most_shooters = shooters < most ? shooters : most;
    for (int team = 0; team < kNTeams; ++team)
      sight_reach[team] = kMore * std::sqrt(max_of(very_close_depth2, cone_depth2 * widest_range[team]));
    hearing_reach = kMore * communication_range;
    touch_reach = kMore * std::sqrt(collision_range2);
    start_reach = kMore * std::sqrt(collision_range2 + kStartMargin);
    margin = 1e-6f * max_of(limit_x, limit_y);
    of_dead = grid_shape(cells_of_dead(n_agents), 0, 0, limit_x, limit_y);
  }

  /// Bits tell the teams of few agents only.
  GIGA_HD int team_of(int i) const { return team_after_team ? (i >= n_team[0] ? 1 : 0) : SimParams::team_of(i); }
  GIGA_HD int slot_of(int i) const { return team_after_team ? i - first_of(team_of(i)) : SimParams::slot_of(i); }
};

/// GridParams, or the same with constants.
template <class P>
concept GridParameters = Parameters<P> && std::derived_from<P, GridParams>;

/// GridParams of which what most crowds have in common are constants of the compiler: fewer instructions and registers.
struct PlainCrowd : GridParams {
  explicit PlainCrowd(const GridParams& p) : GridParams(p) {}
  static constexpr Rules rules = Rules::corrected;
  static constexpr ActionKind actions = ActionKind::discrete;
  static constexpr int n_neighbors = 15, n_boxes = 0;
  static constexpr bool team_after_team = true, waypoints = false, has_idle_reward = false, has_term_factors = false;
  static constexpr bool stochastic_communication = true, stochastic_detection = true;
  static constexpr bool obstacle_heights = false, obstacles_block_sight = false, sight_3d = false;
  static constexpr bool cone_is_full = false, damage_cone_is_full = false, egocentric_view = false;
  GIGA_HD static constexpr bool original() { return false; }
  GIGA_HD int team_of(int i) const { return i >= n_team[0] ? 1 : 0; }
  GIGA_HD int first_of(int team) const { return team == 1 ? n_team[0] : 0; }
  GIGA_HD int end_of(int team) const { return team == 0 ? n_team[0] : n_agents; }
  GIGA_HD int slot_of(int i) const { return i - first_of(team_of(i)); }

  /// Whether a scenario is so.
  static bool fits(const GridParams& p) {
    return p.rules == rules && p.actions == actions && p.n_neighbors == n_neighbors && p.n_boxes == n_boxes &&
           p.team_after_team == team_after_team && p.waypoints == waypoints && p.has_idle_reward == has_idle_reward &&
           p.has_term_factors == has_term_factors && p.stochastic_communication == stochastic_communication &&
           p.stochastic_detection == stochastic_detection && p.obstacle_heights == obstacle_heights &&
           p.obstacles_block_sight == obstacles_block_sight && p.sight_3d == sight_3d &&
           p.cone_is_full == cone_is_full && p.damage_cone_is_full == damage_cone_is_full &&
           p.egocentric_view == egocentric_view;
  }
};

/// An agent where it was when the grid was made, and what whoever looks for it asks first (mark_agents).
struct alignas(16) PlacedAgent {
  float x, y;
  int32_t agent;
  uint32_t marks;
};
enum PlacedMark : uint32_t { kLives = 1, kObserved = 2, kOfTeam1 = 4 };
constexpr int kObserversShift = 8;  ///< above the marks, how many observe it: kKeptDetectors + 1 = more than are kept

/// What AgentNumber has for kNobody.
constexpr uint32_t kNoAgent = 0xFFFFFFFFu;

/// The number of an agent, of 32 bits, where worlds of few agents have uint16_t: compared with kNobody and set to it
/// alike.
struct AgentNumber {
  uint32_t value;

  GIGA_HD AgentNumber& operator=(uint16_t) {  // kNobody, nothing else
    value = kNoAgent;
    return *this;
  }
  GIGA_HD operator int() const { return static_cast<int>(value); }
  GIGA_HD friend constexpr bool operator==(AgentNumber a, uint16_t) { return a.value == kNoAgent; }
  // Not left to the compiler to make of the other: nvcc 13.0 compares the integers instead, in kernels only.
  GIGA_HD friend constexpr bool operator!=(AgentNumber a, uint16_t) { return a.value != kNoAgent; }
};
static_assert(AgentNumber{kNoAgent} == kNobody && !(AgentNumber{kNoAgent} != kNobody));
static_assert(AgentNumber{kNobody} != kNobody && !(AgentNumber{kNobody} == kNobody), "65,535 is an agent");

/// What some agents add to an item of accumulate_episode: returns, masked returns; or a term's alone.
struct StepSum {
  float sum = 0, masked = 0;
  GIGA_HD StepSum& operator+=(const StepSum& more) {
    sum += more.sum;
    masked += more.masked;
    return *this;
  }
};

/// Where the workers of a world put together what one alone would keep to itself (sort_agents of WideLanes). Where each
/// block sorts for itself, `bounds`, `order`, `cell` and the sorted agents are the block's own.
struct SharedWork {
  /// The living, since it was last read: the largest -x, -y, x and y as keys that order like the numbers, 0 = none, and
  /// how many. Zero before the first step; each sort leaves it so.
  struct Bounds {
    uint32_t edge[4];
    int32_t count;
  };
  Bounds* bounds;       // [1]
  GridShape* shape;     // [1] of the grid, for launches that follow: no columns = they leave the world; null = for none
  int32_t* order;       // [N] agents by cell, within one in the order of arrival; where each block sorts for itself
  int32_t* cell;        // [N] of an agent; those of the dead behind those of the living
  int32_t* block_sums;  // [blocks] agents in the cells that a block adds up
  /// GridWorld::placed and cell_begin for launches that follow, where each block sorts for itself; null = for none.
  PlacedAgent* placed_for_all;
  int32_t* cell_begin_for_all;
  bool crews_follow;  // launches of crews, which see to rewards and rows too
  int32_t* summed;    // [teams] blocks whose sums are known, of a launch that waits for nobody; zero before it
  StepSum* sums;  // [n_step_items, sums_of_team] of blocks of agents, of blocks of these, ...; terms have no `masked`
};

/// What a step reads and writes of a world of many agents. Pairs have no tables here: the members of WorldView for them
/// (tracked, detected, seen, hears) are null, and those for numbers of agents are hidden by wider ones.
struct GridWorld : WorldView {
  // State:
  uint32_t* fire;          // [N, most_shooters] entries by the number of the shooter, zeros behind
  AgentNumber* neighbors;  // [N, n_neighbors] agents of the observation's rows; kNobody = row of zeros
  // Scratch:
  AgentNumber* nearest_agents;  // [N, kNearestAgents]
  int32_t* detects;             // [N] opponents that the agent detects
  int32_t* dealt;               // [N] damage units that the agent deals
  int32_t* observers;           // [N] opponents that detect the agent
  int32_t* detectors;           // [N, kKeptDetectors] the first of them, in any order: places, of the agent at a place
  uint8_t* could_see;           // [N] lives after the collisions, when sight is decided
  int32_t* full_lists;          // [1] agents at which more opponents fired than are counted, since it was last read
  PlacedAgent* placed;          // [N] those that lived when the grid was made, by cell; see sort_agents
  int32_t* cell_begin;          // [cells + 1] the first of each cell in `placed`
  int32_t* place;               // [N] of an agent in `placed`; kNotPlaced: it was dead
  SharedWork work;              // of executors with WideLanes
  GridShape grid;

  GIGA_HD CellRange cells(int row, int first_column, int last_column) const {
    const int32_t* begin = cell_begin + row * grid.columns;
    return {begin[first_column], begin[last_column + 1]};
  }
};

/// Calls f(place in `placed`, agent, squared distance) for all that lie within `reach` of a place, and for some that
/// lie a little farther off; in the order of the cells. Each member of a crew is called for its share of them.
template <class Crew, class F>
GIGA_HD void for_near(const Crew& crew, const GridParameters auto& p, const GridWorld& w, float x, float y, float reach,
                      F&& f) {
  const float far = reach + p.margin, far2 = far * far;
  const int first = w.grid.column(x - far), last = w.grid.column(x + far), end = w.grid.row(y + far);
  for (int row = w.grid.row(y - far); row <= end; ++row) {
    const CellRange range = w.cells(row, first, last);
    for (int32_t k = range.begin + crew.index(); k < range.end; k += Crew::kWidth) {
      const PlacedAgent a = w.placed[k];
      const float dx = a.x - x, dy = a.y - y, d2 = dx * dx + dy * dy;
      if (d2 <= far2) f(k, static_cast<int>(a.agent), d2);
    }
  }
}

/// The placed agents around a place: those of the cells up to ring `first`, then ring by ring. for_rings
/// takes one after the other (next); rank_seen enters row by row and takes some at a time (enter, take), so that lanes
/// that look from different places enter rows together; a crew that looks from one enters them side by side (part).
class Rings {
 public:
  GIGA_HD Rings(const GridParams& p, const GridWorld& w, float x, float y, int first)
      : grid_(w.grid),
        cell_begin_(w.cell_begin),
        margin_(p.margin),
        x_(x),
        y_(y),
        column_(w.grid.column(x)),
        row_(w.grid.row(y)),
        first_(first),
        ring_(first),
        at_(row_ - first > 0 ? row_ - first : 0) {}

  /// Whether some of the cells that were entered last are left.
  GIGA_HD bool some_left() const { return k_ != end_; }
  /// Enters the next cells of a row, where none are left; they may be empty. False = the ring ends.
  GIGA_HD bool enter() {
    if (some_left()) return true;
    const int left = column_ - ring_, right = column_ + ring_, low = row_ - ring_, high = row_ + ring_;
    if (at_ > high || at_ >= grid_.rows) return false;
    // A row of the square, or of the ring; between its first and its last row, one of its two ends.
    const bool whole = ring_ == first_ || at_ == low || at_ == high;
    const int from = whole ? (left < 0 ? 0 : left) : right_side_ ? right : left;
    const int to = whole ? (right < grid_.columns ? right : grid_.columns - 1) : from;
    if (from >= 0 && to < grid_.columns) {
      const int32_t* begin = cell_begin_ + at_ * grid_.columns;
      k_ = begin[from];
      end_ = begin[to + 1];
    }
    right_side_ = !whole && !right_side_;
    if (!right_side_) ++at_;
    return true;
  }
  /// The square or the ring as ranges that can be entered side by side: part(0 .. parts() - 1), in any order. The rows
  /// of the square go from the middle outwards.
  GIGA_HD int parts() const { return ring_ == first_ ? 2 * ring_ + 1 : 4 * ring_; }
  GIGA_HD CellRange part(int number) const {
    // The rows of the square; of a ring its first row, its last one, and both ends of each between these.
    const bool square = ring_ == first_, whole = square || number < 2;
    const int left = column_ - ring_, right = column_ + ring_, low = row_ - ring_, high = row_ + ring_;
    const int outwards = number % 2 == 0 ? -(number / 2) : number / 2 + 1;  // 0, 1, -1, 2, -2, ...
    const int row = square ? row_ + outwards : number == 1 ? high : low + number / 2;
    const int from = whole ? (left < 0 ? 0 : left) : number % 2 == 0 ? left : right;
    const int to = whole ? (right < grid_.columns ? right : grid_.columns - 1) : from;
    if (row < 0 || row >= grid_.rows || from < 0 || to >= grid_.columns) return {0, 0};
    const int32_t* begin = cell_begin_ + row * grid_.columns;
    return {begin[from], begin[to + 1]};
  }
  /// The next places in `placed`, at most so many, of some that are left.
  GIGA_HD CellRange take(int most) {
    const int32_t begin = k_;
    k_ = end_ - k_ < most ? end_ : k_ + most;
    return {begin, k_};
  }
  /// The next place in `placed`; -1 = the ring ends.
  GIGA_HD int32_t next() {
    GIGA_ROLLED
    while (!some_left())
      if (!enter()) return -1;
    return take(1).begin;
  }
  /// Goes on to the next ring, after the end of one, and returns the nearest that an agent of it, or beyond, can lie:
  /// behind an open side of the square so far. Infinite where there is no cell.
  GIGA_HD float widen() {
    const int left = column_ - ring_, right = column_ + ring_, low = row_ - ring_, high = row_ + ring_;
    const GridShape& g = grid_;
    float distance = INFINITY;
    if (left > 0) distance = min_of(distance, x_ - (g.x0 + static_cast<float>(left) * g.size_x));
    if (right + 1 < g.columns) distance = min_of(distance, g.x0 + static_cast<float>(right + 1) * g.size_x - x_);
    if (low > 0) distance = min_of(distance, y_ - (g.y0 + static_cast<float>(low) * g.size_y));
    if (high + 1 < g.rows) distance = min_of(distance, g.y0 + static_cast<float>(high + 1) * g.size_y - y_);
    ++ring_;
    at_ = low > 0 ? low - 1 : 0;
    return distance == INFINITY ? distance : distance - margin_;
  }

 private:
  const GridShape& grid_;
  const int32_t* cell_begin_;
  float margin_, x_, y_;
  int column_, row_, first_, ring_, at_;  // at: row of the range that comes next
  bool right_side_ = false;
  int32_t k_ = 0, end_ = 0;
};

/// Calls f(place in `placed`) for the cells up to ring `first` around that of a place, then ring by ring, until
/// `enough(distance)`, asked before each ring, says that agents that lie at least so far off do not matter.
template <class Enough, class F>
GIGA_HD void for_rings(const GridParameters auto& p, const GridWorld& w, float x, float y, int first, Enough&& enough,
                       F&& f) {
  Rings rings(p, w, x, y, first);
  GIGA_ROLLED
  for (;;) {
    const int32_t next = rings.next();
    if (next < 0) {
      const float far = rings.widen();
      if (far == INFINITY || enough(far)) return;
    } else {
      f(next);
    }
  }
}

/// PhiloxDraws for many workers at once and any number of agents: keeps no block of draws, and gives the agents from
/// 65,536 on rows of their own (rules 17.4).
class GridDraws : public KeyedDraws<ScheduledKey> {
 public:
  GIGA_HD GridDraws(const PhiloxKeys& keys, uint32_t world, uint32_t step)
      : KeyedDraws(ScheduledKey(keys, world, step)) {}

  GIGA_HD float comm(int ego, int sender, bool after_reset) {
    return KeyedDraws::comm(static_cast<int>(draw_slot(static_cast<uint32_t>(ego))), sender, after_reset);
  }
};

}  // namespace giga
