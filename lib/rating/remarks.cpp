// What a reader of ratings must know, in sentences.
#include <algorithm>
#include <cmath>

#include "config/names.hpp"
#include "core/error.hpp"
#include "rating/ratings.hpp"

namespace giga {
namespace {

/// What the games between `them` and the anchor's group were like.
std::string reason(const Ratings& ratings, Standing standing) {
  const std::string others = cat(ratings.anchor, " or to who is rated with it");
  if (standing == Standing::above) return cat("never lost a point to ", others);
  if (standing == Standing::below)
    return cat("never took a point from ", ratings.anchor, " or from who is rated with it");
  return cat("no games compare ", "it with ", ratings.anchor);
}

std::string remark_on_one(const Ratings& ratings, const Rating& r) {
  const bool won_all = r.games.losses == 0 && r.games.ties == 0, lost_all = r.games.wins == 0 && r.games.ties == 0;
  const std::string why = won_all    ? cat("won all of its ", n_games(r.games), " games")
                          : lost_all ? cat("lost all of its ", n_games(r.games), " games")
                                     : reason(ratings, r.standing);
  const std::string rating = r.standing == Standing::above   ? "its rating is +infinity"
                             : r.standing == Standing::below ? "its rating is -infinity"
                                                             : cat("it has no rating relative to ", ratings.anchor);
  return cat(ratings.label(r), ": ", why, "; ", rating);
}

std::string remark_on_group(const Ratings& ratings, const std::vector<const Rating*>& members) {
  std::vector<std::string> names, references;
  for (const Rating* r : members) {
    const Estimate& e = r->in_group;
    names.push_back(cat(ratings.label(*r), " ", std::lround(e.value), " +- ", std::lround(e.high() - e.value)));
    const std::string reference = ratings.label(ratings.list[static_cast<size_t>(r->reference)]);
    if (std::find(references.begin(), references.end(), reference) == references.end()) references.push_back(reference);
  }
  const std::string relative = join(references, " and ");
  if (members.front()->standing == Standing::not_compared)
    return cat("no games compare these with ", ratings.anchor, ": ", join(names, "; "),
               "; these are ratings among themselves, relative to ", relative);
  const char* sign = members.front()->standing == Standing::above ? "+" : "-";
  return cat("these ", reason(ratings, members.front()->standing), ": ", join(names, "; "), "; their ratings are ",
             sign, "infinity; those given here are among themselves, relative to ", relative);
}

}  // namespace

std::vector<std::string> remarks(const Ratings& ratings) {
  std::vector<std::string> lines;
  for (int group = 0; group < ratings.n_groups; ++group) {
    for (const Standing standing : {Standing::above, Standing::below, Standing::not_compared}) {
      std::vector<const Rating*> members;
      for (const Rating& r : ratings.list)
        if (r.group == group && r.standing == standing) members.push_back(&r);
      if (members.size() == 1) lines.push_back(remark_on_one(ratings, *members.front()));
      if (members.size() > 1) lines.push_back(remark_on_group(ratings, members));
    }
  }
  for (int player = 0; player < static_cast<int>(ratings.players.size()); ++player)
    if (std::none_of(ratings.list.begin(), ratings.list.end(), [&](const Rating& r) { return r.player == player; }))
      lines.push_back(ratings.players[static_cast<size_t>(player)] + ": played no game; it has no rating");
  if (ratings.side_advantage && !std::isfinite(ratings.side_advantage->value))
    lines.push_back(cat("the games do not tell by how much one side is ahead: they do not compare ", ratings.anchor,
                        " on side 0 with ", ratings.anchor, " on side 1, or never both ways"));
  return lines;
}

}  // namespace giga
