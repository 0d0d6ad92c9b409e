// Ratings as pictures and a table.
#include "report/ratings.hpp"

#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "core/error.hpp"
#include "io/number.hpp"
#include "report/tables.hpp"

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

/// As an image, in which nothing is carried out.
std::string data_url(const std::string& svg) {
  std::string url = "data:image/svg+xml;charset=utf-8,";
  for (const char c : svg) {
    char text[8] = {c};
    const auto byte = static_cast<unsigned char>(c);
    if (!std::isalnum(byte)) std::snprintf(text, sizeof text, "%%%02X", byte);
    url += text;
  }
  return url;
}

}  // namespace

std::string rating_note(const RatingData& ratings) {
  const Node& results = ratings.results;
  std::string note = cat("Elo by maximum likelihood from a round robin on ", text_of(results, "scenario"), ", ",
                         text_of(results, "anchor"), " = 0; a tie is half a win.");
  if (text_of(results, "greedy") == "true") note += " Policies take their most likely actions.";
  std::string changes;
  if (const Node* list = results.find("changes"))
    for (const Node& change : list->items) changes += (changes.empty() ? "" : ", ") + change.text;
  if (!changes.empty()) note += " The game was changed: " + changes + ".";
  if (const Node* remarks = results.find("remarks"))
    for (const Node& remark : remarks->items) note += " Note: " + remark.text + ".";
  return note;
}

void write_rating_section(Markup& page, const RatingData& ratings, const std::string& title) {
  for (const RatingPicture& picture : ratings.pictures) {
    const auto card = page.open("div", {{"class", "card picture"}, {"data-along", picture.along}});
    page.add("img", {{"src", data_url(picture.svg)}, {"alt", title}});
  }
  std::vector<TableRow> rows;
  if (const Node* list = ratings.results.find("ratings"))
    for (const Node& rating : list->items) rows.push_back(table_row(rating));
  write_table(page, "All ratings",
              {"player", "team", "Elo", "+- 95 %", "score", "games", "wins", "ties", "losses", "paper's Elo"}, rows,
              true);
}

}  // namespace giga
