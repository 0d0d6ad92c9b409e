// RatingSheet: a round robin with its ratings and what is known of the players, as tables and files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "io/json.hpp"
#include "rating/ratings.hpp"

namespace giga {

enum class PlayerKind : uint8_t { script, exported, mixed, checkpoint };
/// "script", "exported", "mixed", "checkpoint".
const char* name_of(PlayerKind kind);

/// Where a player comes from; what pictures draw along their x axis.
struct PlayerInfo {
  PlayerKind kind = PlayerKind::script;  ///< all but checkpoints are baselines, without what follows
  std::string run;                       ///< its name: that of the run folder, in one sheet another for each run
  int64_t updates = 0;
  double agent_steps = 0;
  double seconds = 0;            ///< of training, all processes together, as metrics.csv counts them
  bool best = false;             ///< the run's best checkpoint (best.h5)
  std::filesystem::path folder;  ///< the run folder, canonical

  bool is_baseline() const { return kind != PlayerKind::checkpoint; }
};

struct RatingSheet {
  std::string scenario;  ///< name, for titles
  GameTable table;
  std::vector<PlayerInfo> infos;  ///< [P] of the players of the table
  Ratings ratings;                ///< of the table
};

/// A run's checkpoints, the first ones first, as indices of players.
struct RatedRun {
  std::string name;
  std::string short_name;  ///< with several runs: without what the names of all of them begin with
  std::vector<size_t> players;
};
std::vector<RatedRun> runs_of(const RatingSheet& sheet);

/// Names short enough for pictures: of checkpoints "update 300", or with several runs "seed1@300"; of baselines
/// their own. [P]
std::vector<std::string> short_names(const RatingSheet& sheet);

/// For people: a line per rating, the strongest first, how well ratings explain the games, then remarks().
std::string ratings_table(const RatingSheet& sheet);

/// A row per rating in the order of `Ratings::list`. `rating` is inf, -inf or empty, its error and interval empty,
/// where `standing` is not `rated`; `group_rating` is relative to `group_reference` and always there.
std::string ratings_csv(const RatingSheet& sheet);

/// The cross-play matrix: rows side 0, columns side 1, the row's share of points (a tie is half a point); empty where
/// no games were played.
std::string matrix_csv(const RatingSheet& sheet);

/// All of it: players, games (matrices of counts: rows side 0, columns side 1, from side 0's view), ratings (null where
/// infinite or unknown; see `standing`), model, how well it explains the games (model_check.hpp), remarks. `folder` is
/// where it will lie: run folders are told relative to it, so that find_rating() knows them also after both were moved.
Json ratings_json(const RatingSheet& sheet, const std::filesystem::path& folder);

/// Names of the files of a folder of results; reports look for the pictures (lib/report).
struct RatingFiles {
  static constexpr const char* kFolder = "ratings";  ///< in a run folder
  static constexpr const char* kJson = "ratings.json";
  static constexpr const char* kCsv = "ratings.csv";
  static constexpr const char* kMatrixCsv = "matrix.csv";
  static constexpr const char* kRatingPicture = "rating.svg";                 ///< along agent-steps
  static constexpr const char* kRatingTimePicture = "rating_seconds.svg";     ///< along wall-clock time
  static constexpr const char* kWinRatePicture = "win_rate.svg";              ///< along agent-steps
  static constexpr const char* kWinRateTimePicture = "win_rate_seconds.svg";  ///< along wall-clock time
  static constexpr const char* kMatrixPicture = "matrix.svg";
};

/// Writes all files of `RatingFiles` into a folder, which is made where it is missing; files of an earlier call are
/// replaced, and a picture for which there is nothing to draw (pictures.hpp) is removed. `json` is what goes into
/// ratings.json: ratings_json(), with what the caller knows beside it. Throws InputError where the folder cannot be
/// made.
void write_ratings(const std::filesystem::path& folder, const RatingSheet& sheet, const Json& json);

}  // namespace giga
