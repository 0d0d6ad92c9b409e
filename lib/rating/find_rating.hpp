// The rating that a run's folder of ratings has for one of its checkpoints.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "io/json.hpp"

namespace giga {

/// Team `team` of a checkpoint of a run; none: the first of its teams that was rated.
struct RatedPolicy {
  std::filesystem::path run;  ///< its folder; runs of the same name in different places are different runs
  int64_t updates = 0;
  std::optional<int> team = {};
};

/// Its rating with the scenario, the anchor and the number of episodes that it is from, out of a ratings.json (see
/// ratings_json()); `side` is "both" where the ratings are of both teams together. An empty object where the file does
/// not have it. Throws InputError where the file cannot be read.
Json find_rating(const std::filesystem::path& ratings_file, const RatedPolicy& policy);

}  // namespace giga
