// Ratings as pictures and a table.
#include "report/ratings.hpp"

#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

/// A value of a rating as text; "" where there is none.
std::string text_of(const Node& map, const char* key) {
  const Node* value = map.find(key);
  return value && value->is_scalar() ? value->text : "";
}

/// NaN for null and for what is missing.
double number_of(const Node* value) {
  return value && value->is_scalar() ? std::strtod(value->text.c_str(), nullptr) : std::nan("");
}

/// Half the width of the 95 % interval.
double spread_of(const Node& rating) {
  const Node* interval = rating.find("ci95");
  if (!interval || interval->items.size() != 2) return std::nan("");
  return (number_of(&interval->items[1]) - number_of(&interval->items[0])) / 2;
}

std::string whole_number(double value) { return std::isnan(value) ? "-" : print_number(std::round(value)); }

std::vector<std::string> table_row(const Node& rating) {
  const std::string standing = text_of(rating, "standing");
  std::string elo = whole_number(number_of(rating.find("rating")));
  if (standing == "above") elo = "+infinity";
  if (standing == "below") elo = "-infinity";
  std::vector<std::string> row = {text_of(rating, "player"), text_of(rating, "side"), elo,
                                  whole_number(spread_of(rating)), print_share(number_of(rating.find("score")))};
  for (const char* key : {"games", "wins", "ties", "losses"}) row.push_back(text_of(rating, key));
  row.push_back(whole_number(number_of(rating.find("paper_elo"))));
  return row;
}

Json rating_table(const Node& results) {
  Json rows = Json::array();
  if (const Node* ratings = results.find("ratings"))
    for (const Node& rating : ratings->items) rows.push_back(table_row(rating));
  const std::vector<std::string> head = {"player", "team", "Elo",  "+- 95 %", "score",
                                         "games",  "wins", "ties", "losses",  "paper's Elo"};
  return {{"caption", "All ratings"}, {"folded", true}, {"head", head}, {"rows", std::move(rows)}};
}

Json picture_list(const std::vector<RatingPicture>& pictures) {
  Json list = Json::array();
  for (const RatingPicture& p : pictures) list.push_back({{"svg", p.svg}, {"along", p.along}});
  return list;
}

std::string note_of(const Node& results) {
  std::string note = cat("Elo by maximum likelihood from a round robin on ", text_of(results, "scenario"), ", ",
                         text_of(results, "anchor"), " = 0; a tie is half a win.");
  if (const Node* remarks = results.find("remarks"))
    for (const Node& remark : remarks->items) note += " Note: " + remark.text + ".";
  return note;
}

}  // namespace

void add_ratings_sections(const std::vector<RunGroup>& groups, Json& sections) {
  for (const RunGroup& group : groups) {
    for (const RunData* run : group.runs) {
      if (!run->ratings) continue;
      const bool alone = groups.size() == 1 && group.runs.size() == 1;
      sections.push_back({{"kind", "pictures"},
                          {"title", alone ? "Ratings" : "Ratings of " + run->name},
                          {"note", note_of(run->ratings->results)},
                          {"pictures", picture_list(run->ratings->pictures)},
                          {"tables", Json::array({rating_table(run->ratings->results)})}});
    }
  }
}

}  // namespace giga
