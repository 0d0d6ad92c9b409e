#include "sim/observation_text.hpp"

#include <algorithm>
#include <iterator>
#include <span>

#include "sim/observations.hpp"

namespace giga {
namespace {

struct Text {
  const char *name, *meaning;
};
using Texts = std::span<const Text>;

std::vector<FeatureText> features(Texts texts, size_t count) {
  std::vector<FeatureText> list;
  for (const Text& text : texts.first(count)) list.push_back({text.name, text.meaning});
  return list;
}
std::vector<FeatureText> features(Texts texts) { return features(texts, texts.size()); }

/// Parts that have items.
std::vector<ObservationPart> present(std::vector<ObservationPart> parts) {
  std::erase_if(parts, [](const ObservationPart& part) { return part.count == 0 || part.features.empty(); });
  return parts;
}

// The vector observation

/// In the order of Feature.
constexpr Text kAgent[] = {
    {"seen", "1 where an agent stands in this item; else all its numbers are 0"},
    {"same_team", "1 for an agent of the own team, 0 for an opponent"},
    {"x", "x / limit_x"},
    {"y", "y / limit_y"},
    {"z", "altitude / 10"},
    {"heading", "direction of flight in radians"},
    {"speed", "speed / diagonal of the map"},
    {"health", "health"},
    {"sprite", "bit mask of the drawn shape of the agent's type"},
};
static_assert(std::size(kAgent) == kNeighborFeatures);

constexpr Text kWaypoint[] = {
    {"x1", "(left edge - own x) / limit_x"},
    {"y1", "(lower edge - own y) / limit_y"},
    {"x2", "(right edge - own x) / limit_x"},
    {"y2", "(upper edge - own y) / limit_y"},
    {"time", "seconds for which it stays; 0 = there is none"},
};
static_assert(std::size(kWaypoint) == kWaypointFeatures);

constexpr Text kBox[] = {
    {"x1", "left edge / limit_x"},  {"y1", "lower edge / limit_y"}, {"x2", "right edge / limit_x"},
    {"y2", "upper edge / limit_y"}, {"z1", "floor / 10"},           {"z2", "ceiling / 10"},
};

std::vector<ObservationPart> describe_vector(const SimParams& p) {
  std::vector<FeatureText> relative = features(kAgent);
  for (size_t k = kFirstRelative; k <= kLastRelative; ++k) relative[k].meaning += ", minus the agent's own";
  return {{"self", "the agent itself", 1, features(kAgent)},
          {"neighbors", "the agents that it sees, the nearest first, then items of zeros", p.n_neighbors - 1, relative},
          {"waypoint", "the area to be reached, relative to the agent", p.waypoints ? 1 : 0, features(kWaypoint)},
          {"boxes", "the obstacles of the map, then items of zeros", p.n_boxes,
           features(kBox, static_cast<size_t>(box_features(p)))}};
}

// The egocentric view

constexpr Text kViewSelfTexts[] = {
    {"x", "2 x / limit_x - 1"},
    {"y", "2 y / limit_y - 1"},
    {"heading_x", "cosine of the heading"},
    {"heading_y", "sine of the heading"},
    {"z", "altitude / 10"},
    {"speed", "speed / 5"},
    {"health", "health"},
};
static_assert(std::size(kViewSelfTexts) == kViewSelf);

constexpr Text kWall[] = {{"nearness", "1 / (1 + distance of the border or obstacle in this direction)"}};

/// In the order of ViewFeature.
constexpr Text kViewAgentTexts[] = {
    {"nearness", "1 / (1 + distance); 0 = there is none, and all its numbers are 0"},
    {"ahead", "cosine of the bearing"},
    {"left", "sine of the bearing"},
    {"course_ahead", "cosine of its heading minus the agent's own"},
    {"course_left", "sine of the same"},
    {"climb", "(altitude - own altitude) / 10"},
    {"overtakes", "(speed - own speed) / 5"},
    {"health", "health"},
};
static_assert(std::size(kViewAgentTexts) == kViewAgent);

/// Behind the numbers of an agent where a team mixes types.
constexpr Text kViewKindTexts[] = {
    {"sprite_centre", "1 where the drawn shape of its type has a centre (bit 1 of the mask), else 0"},
    {"sprite_edges", "the same of the edges (bit 2)"},
    {"sprite_corners", "the same of the corners (bit 4)"},
};
static_assert(std::size(kViewKindTexts) == kViewKind);

std::vector<ObservationPart> describe_egocentric(const SimParams& p) {
  const auto with_kind = [&p](Texts texts) {
    std::vector<FeatureText> list = features(texts);
    for (const FeatureText& bit : features(kViewKindTexts, static_cast<size_t>(view_kind_columns(p))))
      list.push_back(bit);
    return list;
  };
  return {{"egocentric_self", "the agent itself", 1, with_kind(kViewSelfTexts)},
          {"walls", "walls in directions counterclockwise from straight ahead, at equal angles", kViewRays,
           features(kWall)},
          {"egocentric_waypoint", "the centre of the area to be reached, along the own heading", p.waypoints ? 1 : 0,
           features(kViewAgentTexts, kViewWaypoint)},
          {"egocentric_opponents", "the nearest opponents that it sees, along the own heading, then zeros",
           view_opponents(p), with_kind(kViewAgentTexts)},
          {"egocentric_team_mates", "the nearest team mates that it sees, along the own heading, then zeros",
           view_team_mates(p), with_kind(kViewAgentTexts)}};
}

// The true state

/// In the order of entity_feature.
constexpr Text kEntity[] = {
    {"alive", "1; the numbers of the dead are 0"},
    {"x", "x / limit_x"},
    {"y", "y / limit_y"},
    {"z", "altitude / 10"},
    {"heading_y", "sine of the heading"},
    {"heading_x", "cosine of the heading"},
    {"speed", "speed / 5"},
    {"health", "health"},
    {"health_share", "health / the most that its type can have"},
    {"thrust", "factor of its type"},
    {"range", "factor of its type"},
    {"damage_range", "factor of its type"},
};
static_assert(std::size(kEntity) == kEntityFeatures);

/// In the order of world_feature.
constexpr Text kWorld[] = {
    {"waypoint_x", "centre of the area to be reached / limit_x; 0 = there is none"},
    {"waypoint_y", "the same / limit_y"},
    {"waypoint", "1 where there is one"},
    {"waypoint_time", "seconds for which it stays / 10"},
    {"passed", "share of the episode that has passed; 0 without a time limit"},
};
static_assert(std::size(kWorld) == kWorldFeatures);

std::vector<ObservationPart> describe_state(const SimParams& p) {
  return {{"agents", "all agents, team 0 first", p.n_agents, features(kEntity)},
          {"world", "what is common to all", 1, features(kWorld)},
          {"boxes", "the obstacles of the map, then items of zeros", p.n_boxes,
           features(kBox, static_cast<size_t>(box_features(p)))}};
}

// Images

std::vector<ObservationPart> describe_image(const SimParams& p) {
  return present({{"pixels",
                   "row by row: x from 0 to the right, in each row y from 0 up",
                   p.resolution * p.resolution,
                   {{"red", "0 to 255"}, {"green", "0 to 255"}, {"blue", "0 to 255"}}}});
}

std::vector<ObservationPart> describe_image_state(const SimParams& p) {
  return present({{"image_state",
                   "what the images of all agents are drawn from",
                   ImageState::shape(p).size(),
                   {{"word", "the bits of a number; lib/sim/image_state.hpp has their order"}}}});
}

// The parts of each kind of the table (observations.hpp).
std::vector<ObservationPart> parts_of(VectorObservation, const SimParams& p) { return present(describe_vector(p)); }
std::vector<ObservationPart> parts_of(EgocentricView, const SimParams& p) { return present(describe_egocentric(p)); }
std::vector<ObservationPart> parts_of(StateObservation, const SimParams& p) { return present(describe_state(p)); }
std::vector<ObservationPart> parts_of(EgoImage, const SimParams& p) { return describe_image(p); }
std::vector<ObservationPart> parts_of(GlobalImage, const SimParams& p) { return describe_image(p); }
std::vector<ObservationPart> parts_of(ImageState, const SimParams& p) { return describe_image_state(p); }

}  // namespace

std::vector<ObservationPart> describe(Observation kind, const SimParams& p) {
  std::vector<ObservationPart> parts;
  for_each_observation([&](auto row) {
    if (row.id == kind) parts = parts_of(row, p);
  });
  return parts;
}

}  // namespace giga
