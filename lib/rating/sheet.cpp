// The tables of a sheet, and the folder of results.
#include "rating/sheet.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <system_error>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/metrics_csv.hpp"
#include "io/number.hpp"
#include "rating/model_check.hpp"
#include "rating/pictures.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char* kLineEnd = "\r\n";

std::string csv_line(const std::vector<std::string>& fields) {
  std::string line;
  for (size_t k = 0; k < fields.size(); ++k) line += (k ? "," : "") + csv_field(fields[k]);
  return line + kLineEnd;
}

/// Empty for NaN.
std::string csv_number(double value) { return std::isnan(value) ? "" : print_number(value); }

std::string csv_side(const Rating& r) { return r.side < 0 ? "both" : std::to_string(r.side); }

Json estimate_json(const Estimate& e) {
  return {{"value", e.value}, {"standard_error", e.standard_error}, {"ci95", {e.low(), e.high()}}};
}

Json player_json(const std::string& name, const PlayerInfo& info, const fs::path& folder) {
  if (info.is_baseline()) return {{"name", name}, {"kind", name_of(info.kind)}};
  return {{"name", name},
          {"kind", name_of(info.kind)},
          {"run", info.run},
          {"folder", info.folder.lexically_relative(folder).generic_string()},
          {"updates", info.updates},
          {"agent_steps", info.agent_steps},
          {"seconds", info.seconds},
          {"best", info.best}};
}

Json rating_json(const Ratings& ratings, const Rating& r) {
  return {{"player", ratings.name(r)},
          {"side", r.side < 0 ? Json("both") : Json(r.side)},
          {"standing", name_of(r.standing)},
          {"rating", r.rating.value},
          {"standard_error", r.rating.standard_error},
          {"ci95", {r.rating.low(), r.rating.high()}},
          {"group", r.group},
          {"group_reference", ratings.name(ratings.list[static_cast<size_t>(r.reference)])},
          {"group_rating", r.in_group.value},
          {"group_standard_error", r.in_group.standard_error},
          {"games", n_games(r.games)},
          {"wins", r.games.wins},
          {"ties", r.games.ties},
          {"losses", r.games.losses},
          {"score", share_of_points(r.games)},
          {"paper_elo", r.paper_elo}};
}

/// Rows side 0, columns side 1.
Json matrix_json(const GameTable& table, int Games::*count) {
  const size_t n = table.players.size();
  Json rows = Json::array();
  for (size_t i = 0; i < n; ++i) {
    Json row = Json::array();
    for (size_t j = 0; j < n; ++j) row.push_back(table.games[i * n + j].*count);
    rows.push_back(std::move(row));
  }
  return rows;
}

/// What all names begin with, up to a mark that ends a word; never all of a name.
size_t common_start(const std::vector<std::string>& names) {
  if (names.size() < 2) return 0;
  size_t length = 0, word = 0;
  while (std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    return length + 1 < name.size() && name[length] == names.front()[length];
  })) {
    const char c = names.front()[length++];
    if (c == '-' || c == '_' || c == '.') word = length;
  }
  return word;
}

std::string elo_text(double value) {
  if (std::isnan(value)) return "-";
  if (std::isinf(value)) return value > 0 ? "+infinity" : "-infinity";
  char text[32];
  const long whole = std::lround(value);
  std::snprintf(text, sizeof text, whole == 0 ? "%ld" : "%+ld", whole);
  return text;
}

/// The strongest first: infinitely strong ones, rated ones, infinitely weak ones, then those that are not compared.
std::vector<const Rating*> by_strength(const Ratings& ratings) {
  std::vector<const Rating*> order;
  for (const Rating& r : ratings.list) order.push_back(&r);
  const auto rank = [](const Rating& r) {
    return r.standing == Standing::above   ? 0
           : r.standing == Standing::rated ? 1
           : r.standing == Standing::below ? 2
                                           : 3;
  };
  std::stable_sort(order.begin(), order.end(), [&](const Rating* a, const Rating* b) {
    if (a->side != b->side) return a->side < b->side;
    if (rank(*a) != rank(*b)) return rank(*a) < rank(*b);
    if (a->group != b->group) return a->group < b->group;
    return a->in_group.value > b->in_group.value;
  });
  return order;
}

}  // namespace

const char* name_of(PlayerKind kind) {
  constexpr const char* kNames[] = {"script", "exported", "mixed", "checkpoint"};
  return kNames[static_cast<size_t>(kind)];
}

std::vector<RatedRun> runs_of(const RatingSheet& sheet) {
  std::vector<RatedRun> runs;
  for (size_t k = 0; k < sheet.infos.size(); ++k) {
    const PlayerInfo& info = sheet.infos[k];
    if (info.is_baseline()) continue;
    auto run = std::find_if(runs.begin(), runs.end(), [&](const RatedRun& r) { return r.name == info.run; });
    if (run == runs.end()) run = runs.insert(runs.end(), {info.run, info.run, {}});
    run->players.push_back(k);
  }
  std::vector<std::string> names;
  for (const RatedRun& run : runs) names.push_back(run.name);
  const size_t start = common_start(names);
  for (RatedRun& run : runs) {
    run.short_name = run.name.substr(start);
    std::stable_sort(run.players.begin(), run.players.end(),
                     [&](size_t a, size_t b) { return sheet.infos[a].agent_steps < sheet.infos[b].agent_steps; });
  }
  return runs;
}

std::vector<std::string> short_names(const RatingSheet& sheet) {
  std::vector<std::string> names = sheet.table.players;
  const std::vector<RatedRun> runs = runs_of(sheet);
  for (const RatedRun& run : runs)
    for (const size_t k : run.players)
      names[k] = (runs.size() == 1 ? "update " : run.short_name + "@") + std::to_string(sheet.infos[k].updates);
  return names;
}

std::string ratings_table(const RatingSheet& sheet) {
  const Ratings& ratings = sheet.ratings;
  int width = 6;
  for (const std::string& name : ratings.players) width = std::max(width, static_cast<int>(name.size()));
  const auto padded = [&](const std::string& name) {
    return name + std::string(static_cast<size_t>(width) - name.size(), ' ');
  };
  std::string table =
      padded("player") + "  team     rating   +-95 %   score    games     wins     ties   losses   paper's Elo\n";
  for (const Rating* r : by_strength(ratings)) {
    char line[160];
    const std::string spread =
        std::isnan(r->rating.standard_error) ? "-" : cat(std::lround(r->rating.high() - r->rating.value));
    std::snprintf(line, sizeof line, "  %4s  %9s  %7s   %.3f %8d %8d %8d %8d  %12.0f", csv_side(*r).c_str(),
                  elo_text(r->rating.value).c_str(), spread.c_str(), share_of_points(r->games), n_games(r->games),
                  r->games.wins, r->games.ties, r->games.losses, r->paper_elo);
    table += padded(ratings.name(*r)) + line + "\n";
  }
  table += cat("Elo by maximum likelihood, ", ratings.anchor, " = 0; a tie is half a win.");
  if (ratings.side_advantage && std::isfinite(ratings.side_advantage->value))
    table += cat(" Side ", ratings.side_advantage->value < 0 ? 1 : 0, " is ahead by ",
                 std::lround(std::abs(ratings.side_advantage->value)), " +- ",
                 std::lround(ratings.side_advantage->high() - ratings.side_advantage->value), ".");
  table += "\n" + fit_line(ratings.fit) + "\n" + intransitivity_line(ratings) + "\n";
  for (const std::string& line : remarks(ratings)) table += "note: " + line + "\n";
  return table;
}

std::string ratings_csv(const RatingSheet& sheet) {
  const Ratings& ratings = sheet.ratings;
  std::string text = csv_line({"player",
                               "side",
                               "standing",
                               "rating",
                               "standard_error",
                               "ci95_low",
                               "ci95_high",
                               "group",
                               "group_reference",
                               "group_rating",
                               "group_standard_error",
                               "games",
                               "wins",
                               "ties",
                               "losses",
                               "score",
                               "paper_elo",
                               "run",
                               "updates",
                               "agent_steps",
                               "seconds",
                               "best"});
  for (const Rating& r : ratings.list) {
    const PlayerInfo& info = sheet.infos[static_cast<size_t>(r.player)];
    std::vector<std::string> fields = {ratings.name(r), csv_side(r), name_of(r.standing)};
    for (const double value : {r.rating.value, r.rating.standard_error, r.rating.low(), r.rating.high()})
      fields.push_back(csv_number(value));
    fields.insert(fields.end(), {std::to_string(r.group), ratings.name(ratings.list[static_cast<size_t>(r.reference)]),
                                 csv_number(r.in_group.value), csv_number(r.in_group.standard_error)});
    for (const int count : {n_games(r.games), r.games.wins, r.games.ties, r.games.losses})
      fields.push_back(std::to_string(count));
    fields.insert(fields.end(), {csv_number(share_of_points(r.games)), csv_number(r.paper_elo)});
    if (info.is_baseline()) {
      fields.insert(fields.end(), 5, "");
    } else {
      fields.insert(fields.end(), {info.run, std::to_string(info.updates), csv_number(info.agent_steps),
                                   csv_number(info.seconds), info.best ? "1" : "0"});
    }
    text += csv_line(fields);
  }
  return text;
}

std::string matrix_csv(const RatingSheet& sheet) {
  const GameTable& table = sheet.table;
  const size_t n = table.players.size();
  std::vector<std::string> fields = {"side 0 \\ side 1"};
  fields.insert(fields.end(), table.players.begin(), table.players.end());
  std::string text = csv_line(fields);
  for (size_t i = 0; i < n; ++i) {
    fields = {table.players[i]};
    for (size_t j = 0; j < n; ++j) fields.push_back(csv_number(share_of_points(table.games[i * n + j])));
    text += csv_line(fields);
  }
  return text;
}

Json ratings_json(const RatingSheet& sheet, const fs::path& folder) {
  const Ratings& ratings = sheet.ratings;
  std::error_code code;  // a folder that cannot be reached is told where it is written
  const fs::path whole = fs::weakly_canonical(fs::absolute(folder), code);
  Json players = Json::array(), list = Json::array();
  for (size_t i = 0; i < sheet.infos.size(); ++i)
    players.push_back(player_json(sheet.table.players[i], sheet.infos[i], whole));
  for (const Rating& r : ratings.list) list.push_back(rating_json(ratings, r));
  return {{"scenario", sheet.scenario},
          {"anchor", ratings.anchor},
          {"sides", ratings.sides == Sides::alike ? "alike" : "apart"},
          {"side_advantage", ratings.side_advantage ? estimate_json(*ratings.side_advantage) : Json()},
          {"log_likelihood", ratings.log_likelihood},
          {"iterations", ratings.iterations},
          {"goodness_of_fit", fit_json(ratings.fit)},
          {"intransitivity", intransitivity_json(ratings)},
          {"paper_elo", {{"k", ratings.elo.k}, {"start", ratings.elo.start}}},
          {"players", std::move(players)},
          {"ratings", std::move(list)},
          {"games",
           {{"wins", matrix_json(sheet.table, &Games::wins)},
            {"losses", matrix_json(sheet.table, &Games::losses)},
            {"ties", matrix_json(sheet.table, &Games::ties)}}},
          {"remarks", remarks(ratings)}};
}

void write_ratings(const fs::path& folder, const RatingSheet& sheet, const Json& json) {
  std::error_code code;
  fs::create_directories(folder, code);
  if (code) throw InputError(cat("cannot create the folder ", folder.string(), ": ", code.message()));
  write_file(folder / RatingFiles::kCsv, ratings_csv(sheet));
  write_file(folder / RatingFiles::kMatrixCsv, matrix_csv(sheet));
  constexpr TrainingAxis kSteps = TrainingAxis::agent_steps, kTime = TrainingAxis::seconds;
  const std::pair<const char*, std::string> pictures[] = {
      {RatingFiles::kRatingPicture, rating_picture(sheet, kSteps)},
      {RatingFiles::kRatingTimePicture, rating_picture(sheet, kTime)},
      {RatingFiles::kWinRatePicture, win_rate_picture(sheet, kSteps)},
      {RatingFiles::kWinRateTimePicture, win_rate_picture(sheet, kTime)},
      {RatingFiles::kMatrixPicture, matrix_picture(sheet)}};
  for (const auto& [name, picture] : pictures) {
    if (!picture.empty()) write_file(folder / name, picture);
    if (picture.empty()) fs::remove(folder / name, code);
  }
  write_file(folder / RatingFiles::kJson, json_text(json) + "\n");
}

}  // namespace giga
