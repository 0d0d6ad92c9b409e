// From a table of games to ratings: who is compared with whom, a fit per group, differences to the anchor.
#include "rating/ratings.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/error.hpp"
#include "math/wilson.hpp"
#include "rating/groups.hpp"

namespace giga {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
const double kEloPerNaturalUnit = 400 / std::log(10.0);

void check_table(const GameTable& table) {
  const size_t n = table.players.size();
  GIGA_CHECK(table.games.size() == n * n, table.games.size(), " pairs of ", n, " players");
  if (n == 0) throw InputError("there are no players to be rated");
  for (const Games& g : table.games)
    GIGA_CHECK(g.wins >= 0 && g.losses >= 0 && g.ties >= 0, g.wins, " wins, ", g.losses, " losses, ", g.ties, " ties");
  const std::set<std::string> names(table.players.begin(), table.players.end());
  if (names.size() == n) return;
  for (size_t k = 0; k < n; ++k)
    if (std::count(table.players.begin(), table.players.end(), table.players[k]) > 1)
      throw InputError(cat("two players are called '", table.players[k], "'"));
}

/// Index into a matrix that is stored row by row.
size_t flat(int row, int column, int columns) {
  return static_cast<size_t>(row) * static_cast<size_t>(columns) + static_cast<size_t>(column);
}

/// A group's own fit and where its members are in it.
struct GroupFit {
  std::vector<int> members;  // indices into the list
  StrengthFit fit;
};

/// Rates one table; the members are filled in the order of the functions below.
class Rater {
 public:
  Rater(const GameTable& table, const RatingOptions& options) : table_(table), options_(options) {
    check_table(table);
    result_.players = table.players;
    result_.anchor = options.anchor;
    result_.sides = options.sides;
    result_.elo = options.elo;
  }

  Ratings rate() {
    list_those_who_played();
    find_anchors();
    count_games();
    compare();
    fit_groups();
    for (size_t k = 0; k < result_.list.size(); ++k) place(static_cast<int>(k));
    if (apart()) result_.side_advantage = difference(anchor_[0], anchor_[1]);
    rate_as_the_paper();
    return std::move(result_);
  }

 private:
  bool apart() const { return options_.sides == Sides::apart; }
  int n_players() const { return static_cast<int>(table_.players.size()); }
  const Games& games(int i, int j) const { return table_.games[flat(i, j, n_players())]; }
  Rating& at(int index) { return result_.list[static_cast<size_t>(index)]; }
  const Rating& at(int index) const { return result_.list[static_cast<size_t>(index)]; }

  /// Calls f(index of i, index of j, games) for all pairs that played and count.
  template <class F>
  void for_each_pair(F&& f) const {
    for (int i = 0; i < n_players(); ++i)
      for (int j = 0; j < n_players(); ++j)
        if (n_games(games(i, j)) > 0 && (apart() || i != j)) f(index_of(i, 0), index_of(j, 1), games(i, j));
  }
  int index_of(int player, int side) const { return index_[flat(player, side, kNSides)]; }

  void list_those_who_played() {
    index_.assign(table_.players.size() * kNSides, -1);
    for (int player = 0; player < n_players(); ++player) {
      bool played[kNSides] = {false, false};
      for (int other = 0; other < n_players(); ++other) {
        if (!apart() && other == player) continue;
        played[0] = played[0] || n_games(games(player, other)) > 0;
        played[1] = played[1] || n_games(games(other, player)) > 0;
      }
      if (!apart()) played[0] = played[1] = played[0] || played[1];
      for (int side = 0; side < kNSides; ++side) {
        if (!played[side]) continue;
        if (apart() || side == 0) {
          result_.list.emplace_back();
          result_.list.back().player = player;
          result_.list.back().side = apart() ? side : -1;
        }
        index_[flat(player, side, kNSides)] = static_cast<int>(result_.list.size()) - 1;
      }
    }
  }

  void find_anchors() {
    const auto found = std::find(table_.players.begin(), table_.players.end(), options_.anchor);
    if (found == table_.players.end())
      throw InputError(cat("the anchor '", options_.anchor, "', whose rating is 0, is not among the players"));
    const int player = static_cast<int>(found - table_.players.begin());
    for (int side = 0; side < kNSides; ++side) {
      anchor_[side] = index_of(player, side);
      if (anchor_[side] < 0)
        throw InputError(cat("the anchor '", options_.anchor, "', whose rating is 0, has played no game",
                             apart() ? cat(" on side ", side) : ""));
    }
  }

  void count_games() {
    for_each_pair([&](int a, int b, const Games& g) {
      at(a).games = {at(a).games.wins + g.wins, at(a).games.losses + g.losses, at(a).games.ties + g.ties};
      at(b).games = {at(b).games.wins + g.losses, at(b).games.losses + g.wins, at(b).games.ties + g.ties};
    });
  }

  /// Who took points from whom, and the groups that follow; that of the anchor gets number 0.
  void compare() {
    for_each_pair([&](int a, int b, const Games& g) {
      scores_.push_back({a, b, g.wins + g.ties / 2.0, g.losses + g.ties / 2.0});
    });
    scores_ = one_per_pair(scores_);  // where the sides are alike both ways round are one
    result_.intransitivity = find_intransitivity(static_cast<int>(result_.list.size()), scores_);
    groups_ = find_groups(static_cast<int>(result_.list.size()), scores_);
    result_.n_groups = static_cast<int>(groups_.count);
    const int of_anchor = found_group(anchor_[0]);
    for (size_t k = 0; k < result_.list.size(); ++k) {
      const int g = groups_.group_of[k];
      result_.list[k].group = g == of_anchor ? 0 : g < of_anchor ? g + 1 : g;
    }
  }
  int found_group(int index) const { return groups_.group_of[static_cast<size_t>(index)]; }

  void fit_groups() {
    fits_.resize(groups_.count);
    place_in_group_.resize(result_.list.size());
    for (size_t k = 0; k < result_.list.size(); ++k) {
      std::vector<int>& members = fits_[static_cast<size_t>(result_.list[k].group)].members;
      place_in_group_[k] = static_cast<int>(members.size());
      members.push_back(static_cast<int>(k));
    }
    std::vector<std::vector<PairScore>> own(fits_.size());
    for (const PairScore& p : scores_) {
      if (at(p.a).group != at(p.b).group) continue;
      own[static_cast<size_t>(at(p.a).group)].push_back(
          {place_in_group_[static_cast<size_t>(p.a)], place_in_group_[static_cast<size_t>(p.b)], p.score_a, p.score_b});
    }
    for (size_t g = 0; g < fits_.size(); ++g) {
      fits_[g].fit = fit_bradley_terry(static_cast<int>(fits_[g].members.size()), own[g]);
      result_.log_likelihood += fits_[g].fit.log_likelihood;
      result_.fit += goodness_of_fit(fits_[g].fit, own[g]);
      result_.iterations = std::max(result_.iterations, fits_[g].fit.iterations);
    }
  }

  /// Elo points of one over another; infinite or unknown between groups.
  Estimate difference(int a, int b) const {
    if (at(a).group != at(b).group) {
      const int x = found_group(a), y = found_group(b);
      return {groups_.above(x, y) ? kInfinity : groups_.above(y, x) ? -kInfinity : kUnknown, kUnknown};
    }
    const StrengthFit& fit = fits_[static_cast<size_t>(at(a).group)].fit;
    const int i = place_in_group_[static_cast<size_t>(a)], j = place_in_group_[static_cast<size_t>(b)];
    const double strength = fit.strength[static_cast<size_t>(i)] - fit.strength[static_cast<size_t>(j)];
    return {kEloPerNaturalUnit * strength, kEloPerNaturalUnit * fit.standard_error(i, j)};
  }

  void place(int index) {
    Rating& r = at(index);
    const int anchor = anchor_[std::max(r.side, 0)];
    r.rating = difference(index, anchor);
    if (r.group == at(anchor).group) {
      r.reference = anchor;
    } else {
      r.standing = std::isnan(r.rating.value) ? Standing::not_compared
                   : r.rating.value > 0       ? Standing::above
                                              : Standing::below;
      const std::vector<int>& members = fits_[static_cast<size_t>(r.group)].members;
      r.reference = *std::find_if(members.begin(), members.end(), [&](int k) { return at(k).side == r.side; });
    }
    r.in_group = difference(index, r.reference);
  }

  void rate_as_the_paper() {
    std::vector<EloMatch> matches;
    for_each_pair([&](int a, int b, const Games& g) {
      matches.push_back({a, b, 2 * g.wins > n_games(g) ? 1.0 : 0.0});
    });
    const std::vector<double> elo = sequential_elo(static_cast<int>(result_.list.size()), matches, options_.elo);
    for (size_t k = 0; k < elo.size(); ++k) result_.list[k].paper_elo = elo[k];
  }

  const GameTable& table_;
  const RatingOptions& options_;
  Ratings result_;
  std::vector<int> index_;           // [P, 2] into the list; -1 = played no game
  int anchor_[kNSides] = {-1, -1};   // indices into the list; both the same where the sides are alike
  std::vector<PairScore> scores_;    // by index into the list
  PlayerGroups groups_;              // by index into the list, with their own numbers
  std::vector<GroupFit> fits_;       // by number of Rating::group
  std::vector<int> place_in_group_;  // by index into the list
};

}  // namespace

double Estimate::low() const { return value - kNormal95 * standard_error; }
double Estimate::high() const { return value + kNormal95 * standard_error; }

const char* name_of(Standing standing) {
  static constexpr const char* kNames[] = {"rated", "above", "below", "not_compared"};
  return kNames[static_cast<size_t>(standing)];
}

std::string Ratings::label(const Rating& rating) const {
  return rating.side < 0 ? name(rating) : cat(name(rating), ", team ", rating.side);
}

Ratings rate(const GameTable& table, const RatingOptions& options) { return Rater(table, options).rate(); }

}  // namespace giga
