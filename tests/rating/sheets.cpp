#include "sheets.hpp"

#include "core/error.hpp"
#include "games.hpp"

namespace giga::test {

RatingSheet make_sheet(const SheetOptions& options) {
  RatingSheet sheet;
  sheet.scenario = "duel";
  std::vector<std::string> names = {"random", "noop", "circle"};
  KnownStrengths truth{{0, -60, 140}, {0, -60, 140}, options.sides == Sides::apart ? 80.0 : 0.0};
  sheet.infos.resize(names.size());
  for (size_t run = 0; run < options.runs.size(); ++run) {
    for (int k = 1; k <= options.n_checkpoints; ++k) {
      names.push_back(cat(options.runs[run], "@", 100 * k));
      const double gained = options.gain * k - 30.0 * static_cast<double>(run) * k;
      truth.side_0.push_back(gained);
      truth.side_1.push_back(options.sides == Sides::apart ? gained / 2 : gained);
      sheet.infos.push_back(
          {PlayerKind::checkpoint, options.runs[run], 100 * k, 1e7 * k, 200.0 * k, k == options.n_checkpoints - 1, {}});
    }
  }
  std::mt19937_64 generator(11);
  sheet.table = play_known(truth, options.n_games, true, generator);
  sheet.table.players = names;
  RatingOptions rating_options;
  rating_options.sides = options.sides;
  sheet.ratings = rate(sheet.table, rating_options);
  return sheet;
}

}  // namespace giga::test
