// The formulas of sim/egocentric_view.hpp, from the numbers of sim/vector_observation.hpp.
#include "export/row_view.hpp"

#include <cmath>

#include "core/error.hpp"
#include "sim/egocentric_view.hpp"
#include "sim/vector_observation.hpp"

namespace giga {
namespace {

constexpr float kFar = 1e9f;  // beyond every wall

/// The observer, each number [B, 1].
struct Ego {
  Array seen, x, y, altitude, cosine, sine, speed, health, sprite;
};

Array none_below(const Array& a, float low) { return where(a > low, a, number(a, low)); }
Array near(const Array& distance) { return 1.0f / (1.0f + distance); }

/// The bits of a sprite, each 0 or 1.
std::vector<Array> kind_of(const Array& sprite) {
  std::vector<Array> bits;
  for (int bit = 0; bit < kViewKind; ++bit) {
    const auto shifted = [&](int by) { return whole_part(1.0f / static_cast<float>(1 << by) * sprite); };
    bits.push_back(shifted(bit) - 2.0f * shifted(bit + 1));
  }
  return bits;
}

/// Nearness and bearing of a place.
std::vector<Array> place_of(const Ego& ego, const Array& dx, const Array& dy) {
  const Array distance = square_root(dx * dx + dy * dy), away = distance > 0;
  const Array divisor = where(away, distance, number(distance, 1));
  return {near(distance), where(away, (dx * ego.cosine + dy * ego.sine) / divisor, number(distance, 1)),
          (dy * ego.cosine - dx * ego.sine) / divisor};
}

/// One axis of the lines through the observer: [B, lines], or [B, lines, 1] beside boxes.
struct Axis {
  Array position, across, inverse;  ///< `across`: whether the line is at right angles to the axis

  /// How far along the line a coordinate is.
  Array to(const Array& coordinate) const { return (coordinate - position) * inverse; }
};

Axis axis_of(const Array& position, const Array& direction) {
  const Array across = direction == 0.0f;
  return {position, across, where(across, number(direction, 0), 1.0f / where(across, number(direction, 1), direction))};
}

/// How far the border is, forwards and backwards along lines.
std::pair<Array, Array> border(const Axis& axis, float limit) {
  const Array low = axis.to(number(axis.position, 0)), high = axis.to(number(axis.position, limit));
  const Array beyond = number(axis.position, kFar);
  return {where(axis.across, beyond, maximum(low, high)), where(axis.across, beyond, 0.0f - minimum(low, high))};
}

/// Where lines enter and leave the slab [low, high] of boxes, and which run beside it.
struct Slab {
  Array enter, leave, beside;
};
Slab slab(const Axis& axis, const Array& low, const Array& high) {
  const Array a = axis.to(low), b = axis.to(high);
  const Array outside =
      (axis.position < low) | (axis.position == low) | (axis.position > high) | (axis.position == high);
  return {where(axis.across, number(low, -kFar), minimum(a, b)), where(axis.across, number(low, kFar), maximum(a, b)),
          axis.across & outside};
}

/// Nearness of the first wall in each direction [B, kViewRays].
Array walls_of(const RowView& view, const Ego& ego, const Array& row) {
  constexpr int kLines = kViewRays / 2;
  std::vector<Array> cosines, sines;
  for (int k = 0; k < kLines; ++k) {
    const double angle = k * M_PI / kLines;
    const auto c = static_cast<float>(k == 3 ? 0 : std::cos(angle)), s = static_cast<float>(std::sin(angle));
    cosines.push_back(c * ego.cosine - s * ego.sine);
    sines.push_back(c * ego.sine + s * ego.cosine);
  }
  const Array dx = joined(cosines).named("line_x"), dy = joined(sines).named("line_y");
  const auto [ahead_x, behind_x] = border(axis_of(ego.x, dx), view.limit_x);
  const auto [ahead_y, behind_y] = border(axis_of(ego.y, dy), view.limit_y);
  Array ahead = none_below(minimum(ahead_x, ahead_y).named("ahead"), 0).named("ahead");
  Array behind = none_below(minimum(behind_x, behind_y).named("behind"), 0).named("behind");
  if (view.boxes > 0) {
    const int end = view.row_size(), first = end - view.boxes * view.box_numbers;
    const Array boxes = row.columns(first, end).reshaped({view.boxes, view.box_numbers}).named("boxes");
    const auto side = [&](int k, float scale) { return (scale * boxes.feature(k)).reshaped({1, view.boxes}); };
    const Array x1 = side(0, view.limit_x).named("x1"), y1 = side(1, view.limit_y).named("y1");
    const Array x2 = side(2, view.limit_x).named("x2"), y2 = side(3, view.limit_y).named("y2");
    const Array here_x = ego.x.reshaped({1, 1}), here_y = ego.y.reshaped({1, 1});
    const Axis lines_x = axis_of(here_x, dx.reshaped({kLines, 1}).named("box_line_x"));
    const Axis lines_y = axis_of(here_y, dy.reshaped({kLines, 1}).named("box_line_y"));
    const Slab sx = slab(lines_x, x1, x2), sy = slab(lines_y, y1, y2);
    Array solid = ((x1 < x2) & (y1 < y2) & !(sx.beside | sy.beside)).named("solid");
    if (view.box_numbers == 6) {
      const Array z = ego.altitude.reshaped({1, 1});
      solid = (solid & !((z < side(4, 1)) | (z > side(5, 1)))).named("solid");
    }
    const Array enter = maximum(sx.enter, sy.enter).named("enter");
    const Array leave = minimum(sx.leave, sy.leave).named("leave");
    const Array met = (solid & (enter < leave)).named("met");
    const Array beyond = number(enter, kFar);
    ahead = minimum(ahead, least(where(met & (leave > 0), none_below(enter, 0), beyond))).named("ahead");
    behind = minimum(behind, least(where(met & (enter < 0), none_below(0.0f - leave, 0), beyond))).named("behind");
  }
  return joined({near(ahead), near(behind)}).named("walls");
}

/// The nearest `most` agents of those in `wanted` [B, neighbors], 0 or 1 each.
void add_agents(const RowView& view, const Ego& ego, const Array& agents, const Array& wanted, int most,
                std::vector<Array>& parts) {
  const Array rank = running_sum(wanted).named("rank");
  const float diagonal = std::sqrt(view.limit_x * view.limit_x + view.limit_y * view.limit_y);
  for (int k = 1; k <= most; ++k) {
    const Array chosen = where(rank == static_cast<float>(k), wanted, number(wanted, 0)).reshaped({view.neighbors, 1});
    const Array agent = sum_of_items(chosen * agents).named("agent");  // zeros where there is none
    const auto feature = [&](int f) { return agent.column(f); };
    std::vector<Array> numbers =
        place_of(ego, (view.limit_x * feature(kX)).named("dx"), (view.limit_y * feature(kY)).named("dy"));
    numbers.insert(numbers.end(), {cosine(feature(kHeading)), sine(feature(kHeading)), feature(kZ),
                                   0.2f * diagonal * feature(kSpeed), feature(kHealth)});
    if (view.kinds)
      for (const Array& bit : kind_of(feature(kSprite))) numbers.push_back(bit);
    parts.push_back((feature(kSeen) * joined(numbers)).named("agent"));
  }
}

}  // namespace

int RowView::row_size() const {
  return (1 + neighbors) * kNeighborFeatures + (waypoint ? kWaypointFeatures : 0) + boxes * box_numbers;
}

int RowView::view_size() const {
  const int kind = kinds ? kViewKind : 0;
  return kViewSelf + kind + kViewRays + (waypoint ? kViewWaypoint : 0) + (opponents + team_mates) * (kViewAgent + kind);
}

std::optional<RowView> row_view(const SimSpec& spec) {
  const SimParams& p = spec.params;
  if (!p.egocentric_view) return std::nullopt;
  RowView view{p.n_neighbors - 1, p.waypoints,       p.n_boxes,          box_features(p), p.limit_x,
               p.limit_y,         view_opponents(p), view_team_mates(p), p.mixed_teams};
  GIGA_CHECK(view.size() == spec.observation_size(), view.size(), " numbers, not ", spec.observation_size());
  return view;
}

Array with_view(const RowView& view, const Array& row) {
  const auto own = [&](int feature) { return row.column(feature); };
  const float diagonal = std::sqrt(view.limit_x * view.limit_x + view.limit_y * view.limit_y);
  const Ego ego{own(kSeen),
                (view.limit_x * own(kX)).named("x"),
                (view.limit_y * own(kY)).named("y"),
                own(kZ),
                cosine(own(kHeading)).named("cosine"),
                sine(own(kHeading)).named("sine"),
                (0.2f * diagonal * own(kSpeed)).named("speed"),
                own(kHealth),
                own(kSprite)};
  std::vector<Array> parts = {
      2.0f * own(kX) - 1.0f, 2.0f * own(kY) - 1.0f, ego.cosine, ego.sine, ego.altitude, ego.speed, ego.health};
  if (view.kinds)
    for (const Array& bit : kind_of(ego.sprite)) parts.push_back(bit);
  parts.push_back(walls_of(view, ego, row));
  const int behind_agents = (1 + view.neighbors) * kNeighborFeatures;
  if (view.waypoint) {
    const auto corner = [&](int k) { return row.column(behind_agents + k); };
    const Array dx = (0.5f * view.limit_x * (corner(0) + corner(2))).named("dx");
    const Array dy = (0.5f * view.limit_y * (corner(1) + corner(3))).named("dy");
    const Array place = joined(place_of(ego, dx, dy));
    parts.push_back(where(corner(4) > 0, place, 0.0f * place).named("waypoint"));
  }
  if (view.neighbors > 0) {
    const Array agents =
        row.columns(kNeighborFeatures, behind_agents).reshaped({view.neighbors, kNeighborFeatures}).named("agents");
    const Array seen = agents.feature(kSeen).named("seen"), mate = agents.feature(kSameTeam).named("mate");
    add_agents(view, ego, agents, (seen * (1.0f - mate)).named("wanted"), view.opponents, parts);
    add_agents(view, ego, agents, (seen * mate).named("wanted"), view.team_mates, parts);
  } else {  // a row of the observer alone
    const int numbers = (view.opponents + view.team_mates) * (kViewAgent + (view.kinds ? kViewKind : 0));
    for (int k = 0; k < numbers; ++k) parts.push_back(0.0f * ego.seen);
  }
  std::vector<Array> all = {row};
  if (const int gap = view.view_at() - view.row_size(); gap > 0) all.push_back(0.0f * row.columns(0, gap));
  all.push_back(ego.seen * joined(parts).named("view"));
  return joined(all);
}

}  // namespace giga
