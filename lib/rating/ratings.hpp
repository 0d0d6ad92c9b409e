// Ratings of all players of a round robin on one Elo scale, with their errors.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rating/game_table.hpp"
#include "rating/goodness_of_fit.hpp"
#include "rating/intransitivity.hpp"
#include "rating/sequential_elo.hpp"

namespace giga {

inline int n_games(const Games& g) { return g.wins + g.losses + g.ties; }
/// A win is a point, a tie half a point; NaN without games.
inline double share_of_points(const Games& g) { return (g.wins + g.ties / 2.0) / n_games(g); }

/// Whether the sides of a game are alike.
///
/// `alike`: a player has one rating, whichever side it plays:
///     P(i on side 0 beats j on side 1) = 1 / (1 + 10^((r_j - r_i) / 400)).
/// `apart`: a player has a rating per side. The two sides are populations of their own, games are only between them,
/// and
///     P(i on side 0 beats j on side 1) = 1 / (1 + 10^((r1_j - r0_i - advantage) / 400)).
/// The anchor is at 0 on both sides; `advantage` is what side 0 is ahead where the anchor plays itself. Ratings of the
/// same side are compared by their difference; those of different sides say how far each is from the anchor on its
/// side.
enum class Sides { alike, apart };

struct RatingOptions {
  std::string anchor = "random";  ///< the player at 0
  Sides sides = Sides::alike;
  EloOptions elo;  ///< of the paper's rating
};

/// Elo points, with the standard error from the Hessian of the log-likelihood. That of a difference is of the
/// difference: var(a) + var(b) - 2 cov(a, b), so that it depends on the games that join the two.
struct Estimate {
  double value = 0, standard_error = 0;
  double low() const;   ///< of the 95 % interval
  double high() const;  ///< of the 95 % interval
};

/// How a player stands to the anchor (of its side).
enum class Standing {
  rated,         ///< a finite rating
  above,         ///< infinitely far above: it, or who it is joined to, never lost a point to the anchor's group
  below,         ///< infinitely far below
  not_compared,  ///< no games join it to the anchor
};
/// "rated", "above", "below", "not_compared".
const char* name_of(Standing standing);

struct Rating {
  int player = 0;  ///< index into `players`
  int side = -1;   ///< 0 or 1; -1 = both (Sides::alike)
  Standing standing = Standing::rated;
  Estimate rating;    ///< difference to the anchor; +inf, -inf or NaN, with error NaN, where not `rated`
  int group = 0;      ///< ratings are compared within a group (groups.hpp); 0 = that of the anchor (of side 0)
  int reference = 0;  ///< index into `list`: the first of the group, or the anchor, on the same side
  Estimate in_group;  ///< difference to the reference: finite always
  Games games;        ///< all that count, from this player's view
  double paper_elo = 0;
};

struct Ratings {
  std::vector<std::string> players;
  std::string anchor;
  Sides sides = Sides::alike;
  std::vector<Rating> list;  ///< by player, then side; who played no game (on a side) is not in it
  int n_groups = 0;
  /// Sides::apart: of side 0. +inf or -inf where one anchor never lost a point to the other side's, NaN where no games
  /// join them.
  std::optional<Estimate> side_advantage;
  double log_likelihood = 0;  ///< over the games within groups; those between groups are certain in the limit
  int iterations = 0;         ///< of Newton's method, in the group that took most
  GoodnessOfFit fit;          ///< of the games within groups, the groups added up
  /// Of all games, also those between groups; players are indices into `list`. Where the sides are apart a player is a
  /// row or a column, games are between the two kinds, and there is no cycle of three.
  Intransitivity intransitivity;
  EloOptions elo;

  const std::string& name(const Rating& rating) const { return players[static_cast<size_t>(rating.player)]; }
  /// "circle", or where the sides are apart "circle, team 0".
  std::string label(const Rating& rating) const;
};

/// Rates the players of a table by maximum likelihood (bradley_terry.hpp). The order of games cannot matter, that of
/// players does not (but for the last digits, the choice of references, and `paper_elo`).
///
/// Nothing is made finite that is not: a player that never lost (won) a point stands infinitely `above` (`below`), one
/// without games against the anchor's group is `not_compared`; both are rated among those with whom games compare them.
/// A player's games against itself count where the sides are apart and are left out where they are alike.
///
/// `paper_elo`: sequential Elo over the pairs of the table, row by row, a match being all games of a pair, won by side
/// 0 where it won more than half of them and by side 1 elsewhere (the original counts so).
///
/// Throws InputError where the anchor is not among the players or has no game (on a side that others play).
Ratings rate(const GameTable& table, const RatingOptions& options);

/// In sentences what a reader must know: who has no finite rating and why, which groups no games join.
std::vector<std::string> remarks(const Ratings& ratings);

}  // namespace giga
