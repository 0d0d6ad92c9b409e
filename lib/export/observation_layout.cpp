// The meaning of each number of an observation, as sim/observe.hpp makes it.
#include "export/observation_layout.hpp"

#include <iterator>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "scenario/scenario.hpp"
#include "sim/observe.hpp"

namespace giga {
namespace {

constexpr const char *kSelf = "self", *kNeighbors = "neighbors", *kWaypoint = "waypoint", *kBoxes = "boxes",
                     *kUnused = "unused", *kBodySelfBlock = "body_self", *kWalls = "walls",
                     *kBodyWaypointBlock = "body_waypoint", *kBodyOpponentsBlock = "body_opponents",
                     *kBodyTeamMatesBlock = "body_team_mates";

struct FeatureText {
  const char *name, *meaning;
};

/// In the order of Feature.
constexpr FeatureText kAgentFeatures[] = {
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
static_assert(std::size(kAgentFeatures) == kNeighborFeatures);

constexpr FeatureText kWaypointTexts[] = {
    {"x1", "(left edge - own x) / limit_x"},
    {"y1", "(lower edge - own y) / limit_y"},
    {"x2", "(right edge - own x) / limit_x"},
    {"y2", "(upper edge - own y) / limit_y"},
    {"time", "seconds for which it stays; 0 = there is none"},
};
static_assert(std::size(kWaypointTexts) == kWaypointFeatures);

constexpr FeatureText kBoxTexts[] = {
    {"x1", "left edge / limit_x"},  {"y1", "lower edge / limit_y"}, {"x2", "right edge / limit_x"},
    {"y2", "upper edge / limit_y"}, {"z1", "floor / 10"},           {"z2", "ceiling / 10"},
};

constexpr FeatureText kBodySelfTexts[] = {
    {"x", "2 x / limit_x - 1"},
    {"y", "2 y / limit_y - 1"},
    {"heading_x", "cosine of the heading"},
    {"heading_y", "sine of the heading"},
    {"z", "altitude / 10"},
    {"speed", "speed / 5"},
    {"health", "health"},
};
static_assert(std::size(kBodySelfTexts) == kBodySelf);

constexpr FeatureText kWallTexts[] = {{"nearness", "1 / (1 + distance of the border or obstacle in this direction)"}};

constexpr FeatureText kBodyAgentTexts[] = {
    {"nearness", "1 / (1 + distance); 0 = there is none, and all its numbers are 0"},
    {"ahead", "cosine of the bearing"},
    {"left", "sine of the bearing"},
    {"course_ahead", "cosine of its heading minus the agent's own"},
    {"course_left", "sine of the same"},
    {"climb", "(altitude - own altitude) / 10"},
    {"overtakes", "(speed - own speed) / 5"},
    {"health", "health"},
};
static_assert(std::size(kBodyAgentTexts) == kBodyAgent);

/// Behind the numbers of an agent where a team mixes kinds.
constexpr FeatureText kBodyKindTexts[] = {
    {"sprite_centre", "1 where the drawn shape of its type has a centre (bit 1 of the mask), else 0"},
    {"sprite_edges", "the same of the edges (bit 2)"},
    {"sprite_corners", "the same of the corners (bit 4)"},
};
static_assert(std::size(kBodyKindTexts) == kBodyKind);

template <size_t N>
std::vector<ObservationFeature> features(const FeatureText (&texts)[N], int size) {
  std::vector<ObservationFeature> list;
  for (int k = 0; k < size && k < static_cast<int>(N); ++k) list.push_back({texts[k].name, texts[k].meaning});
  return list;
}

/// The numbers of an agent in the body view, then its kind where the item is long enough for it.
template <size_t N>
std::vector<ObservationFeature> with_kind(const FeatureText (&texts)[N], int size) {
  std::vector<ObservationFeature> list = features(texts, size);
  for (const ObservationFeature& bit : features(kBodyKindTexts, size - static_cast<int>(N))) list.push_back(bit);
  return list;
}

/// "45 numbers: self 1 x 9, neighbors 4 x 9".
std::string layout_text(const PolicyInterface& policy) {
  std::string text;
  for (const ObservationBlock& b : policy.observation)
    text += cat(text.empty() ? ": " : ", ", b.name, " ", b.count, " x ", b.size);
  return cat(policy.inputs, " numbers", text);
}

}  // namespace

std::vector<ObservationBlock> observation_layout(const SimSpec& spec) {
  const SimParams& p = spec.params;
  std::vector<ObservationBlock> blocks;
  int at = 0;
  const auto add = [&](const char* name, int count, int size) {
    if (count > 0 && size > 0) blocks.push_back({name, at, count, size});
    at += count * size;
  };
  add(kSelf, 1, kNeighborFeatures);
  add(kNeighbors, p.n_neighbors - 1, kNeighborFeatures);
  add(kWaypoint, p.waypoints ? 1 : 0, kWaypointFeatures);
  add(kBoxes, p.n_boxes, box_features(p));
  if (p.body_view) {
    add(kUnused, 1, body_at(p) - at);
    add(kBodySelfBlock, 1, body_self_columns(p));
    add(kWalls, kBodyRays, 1);
    add(kBodyWaypointBlock, p.waypoints ? 1 : 0, kBodyWaypoint);
    add(kBodyOpponentsBlock, body_opponents(p), body_agent_columns(p));
    add(kBodyTeamMatesBlock, body_team_mates(p), body_agent_columns(p));
  }
  GIGA_CHECK(at == spec.observation_size(), "the layout has ", at, " numbers, observations ", spec.observation_size());
  return blocks;
}

std::string block_meaning(const std::string& block) {
  if (block == kSelf) return "the agent itself";
  if (block == kNeighbors) return "the agents that it sees, the nearest first, then items of zeros";
  if (block == kWaypoint) return "the area to be reached, relative to the agent";
  if (block == kBoxes) return "the obstacles of the map, then items of zeros";
  if (block == kUnused) return "zeros, so that the body view starts at a multiple of 8";
  if (block == kBodySelfBlock) return "the agent itself, once more";
  if (block == kWalls) return "walls in directions counterclockwise from straight ahead, at equal angles";
  if (block == kBodyWaypointBlock) return "the centre of the area to be reached, along the own heading";
  if (block == kBodyOpponentsBlock) return "the nearest opponents that it sees, along the own heading, then zeros";
  if (block == kBodyTeamMatesBlock) return "the nearest team mates that it sees, along the own heading, then zeros";
  return "";
}

std::vector<ObservationFeature> block_features(const std::string& block, int size) {
  if (block == kWaypoint) return features(kWaypointTexts, size);
  if (block == kBoxes) return features(kBoxTexts, size);
  if (block == kUnused) return std::vector<ObservationFeature>(static_cast<size_t>(size), {"zero", "0"});
  if (block == kBodySelfBlock) return with_kind(kBodySelfTexts, size);
  if (block == kWalls) return features(kWallTexts, size);
  if (block == kBodyWaypointBlock) return features(kBodyAgentTexts, size);
  if (block == kBodyOpponentsBlock || block == kBodyTeamMatesBlock) return with_kind(kBodyAgentTexts, size);
  if (block != kSelf && block != kNeighbors) return {};
  std::vector<ObservationFeature> list = features(kAgentFeatures, size);
  if (block == kNeighbors)
    for (int k = kFirstRelative; k <= kLastRelative && k < static_cast<int>(list.size()); ++k)
      list[static_cast<size_t>(k)].meaning += ", minus the agent's own";
  return list;
}

bool PolicyInterface::fits(const PolicyInterface& other) const {
  return actions == other.actions && inputs == other.inputs && observation == other.observation;
}

PolicyInterface interface_of(const SimSpec& spec) {
  return {spec.name, spec.params.actions, spec.observation_size(), observation_layout(spec)};
}

void check_fits(const PolicyInterface& policy, const SimSpec& spec, const std::string& source) {
  const PolicyInterface here = interface_of(spec);
  if (policy.fits(here)) return;
  const auto kind = [](ActionKind actions) { return FieldCodec<ActionKind>::print(actions); };
  if (policy.actions != here.actions)
    throw InputError(cat(source, " was trained in '", policy.scenario, "' with ", kind(policy.actions),
                         " actions; those of '", here.scenario, "' are ", kind(here.actions)));
  throw InputError(cat(source, " was trained in '", policy.scenario, "', where an agent observes ", layout_text(policy),
                       "; in '", here.scenario, "' it observes ", layout_text(here)));
}

}  // namespace giga
