// Pictures of a sheet, as SVG; empty where there is nothing to draw.
#pragma once

#include <cstdint>
#include <string>

#include "rating/sheet.hpp"

namespace giga {

/// What training is measured in along the x axis: agent-steps, which say how much a run learned from, or seconds of
/// wall-clock time over all processes of a run, which say how long it took.
enum class TrainingAxis : uint8_t { agent_steps, seconds };

/// Elo over training with 95 % intervals (Fig. 5b of the paper): a line per run, baselines as horizontal lines; a panel
/// per side where the sides are apart. What has no finite rating is a triangle at the edge. Shown is the anchor's
/// group, or where no checkpoint is in it, the largest group, relative to its reference.
std::string rating_picture(const RatingSheet& sheet, TrainingAxis along);

/// Share of games won against each baseline over training with Wilson's 95 % intervals (Fig. 5a of the paper): a panel
/// per baseline, a line per run and side.
std::string win_rate_picture(const RatingSheet& sheet, TrainingAxis along);

/// The cross-play matrix: rows side 0, columns side 1, the row's share of points.
std::string matrix_picture(const RatingSheet& sheet);

}  // namespace giga
