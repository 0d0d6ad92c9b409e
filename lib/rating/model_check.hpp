// How well ratings explain the games, for people and as JSON.
#pragma once

#include <string>

#include "io/json.hpp"
#include "rating/ratings.hpp"

namespace giga {

/// "Fit: deviance 12.3 on 10 degrees of freedom, p = 0.26.", with what makes p rough.
std::string fit_line(const GoodnessOfFit& fit);

/// "Intransitive: 3.1 % of the squared log-odds ...", with the strongest cycle of three where there can be one.
std::string intransitivity_line(const Ratings& ratings);

/// {deviance, degrees_of_freedom, p_value (null without degrees of freedom), pairs, sparse_pairs}: see GoodnessOfFit.
Json fit_json(const GoodnessOfFit& fit);

/// {share, share_by_chance, pairs, strongest_cycle: null or {players: [3], log_odds: [3], sum, standard_error, ci95}}:
/// see Intransitivity; shares are null where all log-odds are 0.
Json intransitivity_json(const Ratings& ratings);

}  // namespace giga
