// The ratings of a report: what `gigastep rate` left in a run folder.
#pragma once

#include <string>

#include "chart/markup.hpp"
#include "report/run_data.hpp"

namespace giga {

/// How the ratings were made, and what a reader must know of them.
std::string rating_note(const RatingData& ratings);

/// The pictures, each shown while the charts are along its x axis, and the table of all ratings.
void write_rating_section(Markup& page, const RatingData& ratings, const std::string& title);

}  // namespace giga
