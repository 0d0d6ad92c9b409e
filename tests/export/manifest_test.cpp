// Manifests: what they say about observations and actions, and what is refused.
#include "export/manifest.hpp"

#include <gtest/gtest.h>

#include "config/document.hpp"
#include "io/temporary_folder.hpp"
#include "policies.hpp"
#include "sim/vector_observation.hpp"
#include "support/sim_specs.hpp"

namespace giga::test {
namespace {

Manifest sample(ActionKind actions) {
  const SimSpec spec = small_spec(actions);
  PolicyShape shape{kInputs, actions, {{12, 10}, Activation::gelu, true}, true};
  std::vector<float> log_std;
  if (actions == ActionKind::continuous) log_std = {-0.5f, 0.25f, -1};
  return {ExportFormat::onnx, shape, observation_layout(spec), Rules::original, log_std, sample_origin()};
}
std::string text_of(const Manifest& manifest) { return manifest_text(manifest); }

/// The value at a path of keys and indices.
const Node& at(const Node& node, const std::vector<std::string>& path) {
  const Node* here = &node;
  for (const std::string& key : path) {
    here = here->is_sequence() ? &here->items.at(std::stoul(key)) : here->find(key);
    GIGA_CHECK(here, "no ", key);
  }
  return *here;
}

TEST(ExportManifest, LayoutByHand) {
  // 9 of the agent, 3 x 9 of the others, 5 of the waypoint, 2 x 4 of the boxes.
  const std::vector<ObservationBlock> expected = {
      {"self", 0, 1, 9}, {"neighbors", 9, 3, 9}, {"waypoint", 36, 1, 5}, {"boxes", 41, 2, 4}};
  EXPECT_EQ(observation_layout(small_spec(ActionKind::discrete)), expected);
}

TEST(ExportManifest, LayoutOfTheEgocentricViewByHand) {
  SimSpec spec = small_spec(ActionKind::discrete);
  spec.params.egocentric_view = true;
  // From the first multiple of 8 behind the 49 numbers above: 7 of the agent, 12 directions, 3 of the waypoint, 2
  // opponents and 1 mate of 8 each.
  const std::vector<ObservationBlock> blocks = observation_layout(spec);
  const std::vector<ObservationBlock> expected = {{"unused", 49, 1, 7},
                                                  {"egocentric_self", 56, 1, 7},
                                                  {"walls", 63, 12, 1},
                                                  {"egocentric_waypoint", 75, 1, 3},
                                                  {"egocentric_opponents", 78, 2, 8},
                                                  {"egocentric_team_mates", 94, 1, 8}};
  EXPECT_EQ(std::vector<ObservationBlock>(blocks.begin() + 4, blocks.end()), expected);
}

TEST(ExportManifest, LayoutOfTheEgocentricViewOfMixedTeams) {
  SimSpec spec = small_spec(ActionKind::discrete);
  spec.params.egocentric_view = true;
  spec.agents[0].sprite = 6;
  spec.finish();
  // As above, with three bits of the sprite behind the numbers of each agent.
  const std::vector<ObservationBlock> blocks = observation_layout(spec);
  const std::vector<ObservationBlock> expected = {{"unused", 49, 1, 7},
                                                  {"egocentric_self", 56, 1, 10},
                                                  {"walls", 66, 12, 1},
                                                  {"egocentric_waypoint", 78, 1, 3},
                                                  {"egocentric_opponents", 81, 2, 11},
                                                  {"egocentric_team_mates", 103, 1, 11}};
  EXPECT_EQ(std::vector<ObservationBlock>(blocks.begin() + 4, blocks.end()), expected);
  for (const ObservationBlock& block : {blocks[5], blocks[8], blocks[9]}) {
    const std::vector<FeatureText>& features = block.features;
    ASSERT_EQ(features.size(), static_cast<size_t>(block.size));
    EXPECT_EQ(features[static_cast<size_t>(block.size) - 4].name, "health");
    EXPECT_EQ(features[static_cast<size_t>(block.size) - 3].name, "sprite_centre");
    EXPECT_EQ(features.back().name, "sprite_corners");
  }
}

TEST(ExportManifest, LayoutsCoverEveryObservation) {
  for (unsigned mask = 0; mask < kNSwitchMasks; mask += 7) {
    SimSpec spec = random_spec(mask, 1 + static_cast<int>(mask % 3), 2);
    set_switches(spec, mask);
    spec.finish();
    int at = 0;
    for (const ObservationBlock& block : observation_layout(spec)) {
      EXPECT_EQ(block.first, at);
      EXPECT_EQ(block.features.size(), static_cast<size_t>(block.size)) << block.name;
      EXPECT_FALSE(block.meaning.empty());
      at = block.end();
    }
    EXPECT_EQ(at, spec.observation_size());
  }
}

TEST(ExportManifest, NamesOfAgentFeaturesFollowTheSimulator) {
  const std::vector<FeatureText> features = observation_layout(small_spec(ActionKind::discrete))[1].features;
  const std::pair<Feature, const char*> expected[] = {
      {kSeen, "seen"},       {kSameTeam, "same_team"}, {kX, "x"},           {kY, "y"},          {kZ, "z"},
      {kHeading, "heading"}, {kSpeed, "speed"},        {kHealth, "health"}, {kSprite, "sprite"}};
  for (const auto& [index, name] : expected) {
    EXPECT_EQ(features[index].name, name);
    const bool relative = features[index].meaning.find("minus the agent's own") != std::string::npos;
    EXPECT_EQ(relative, index >= kFirstRelative && index <= kLastRelative) << name;
  }
}

TEST(ExportManifest, SaysWhereEachNumberStands) {
  const Document json = parse_yaml_text(text_of(sample(ActionKind::discrete)), "manifest");
  const Node& feature = at(json.root, {"observation", "blocks", "3", "features", "2"});
  EXPECT_EQ(at(feature, {"name"}).text, "x2");
  EXPECT_EQ(print_node(at(feature, {"slice"})), "[43, 49, 4]");  // of two boxes: 43 and 47
  EXPECT_EQ(at(json.root, {"observation", "size"}).text, "49");
  EXPECT_EQ(at(json.root, {"action", "output"}).text, "logits");
}

TEST(ExportManifest, SaysInWhichArithmeticItWasTrained) {
  Manifest manifest = sample(ActionKind::discrete);
  manifest.origin.precision = Precision::fp16;
  const Document json = parse_yaml_text(text_of(manifest), "manifest");
  EXPECT_EQ(at(json.root, {"architecture", "training_precision"}).text, "fp16");
  const std::string text = at(json.root, {"architecture", "training_arithmetic"}).text;
  EXPECT_TRUE(contains(
      text, {"on a GPU: weights, biases and what a layer takes in rounded to half precision", "on a CPU: fp32"}));
  EXPECT_EQ(parse_manifest(text_of(manifest), "manifest.json").origin.precision, Precision::fp16);
}

TEST(ExportManifest, TableOfActions) {
  const Document json = parse_yaml_text(text_of(sample(ActionKind::discrete)), "manifest");
  const Node& table = at(json.root, {"action", "table"});
  ASSERT_EQ(table.items.size(), 27u);
  EXPECT_EQ(print_node(table.items[13]), "{index: 13, heading: 0, dive: 0, throttle: 0}");
  // 23 = 9 (1 + 1) + 3 (0 + 1) + (1 + 1)
  EXPECT_EQ(print_node(table.items[23]), "{index: 23, heading: 0, dive: 1, throttle: 1}");
}

TEST(ExportManifest, ReadsBackToTheSame) {
  for (const ActionKind actions : {ActionKind::discrete, ActionKind::continuous}) {
    const std::string text = text_of(sample(actions));
    Manifest read = parse_manifest(text, "manifest.json");
    ASSERT_EQ(read.observation, sample(actions).observation);
    read.observation = sample(actions).observation;  // with what the numbers mean, which nobody reads back
    EXPECT_EQ(text_of(read), text);
    EXPECT_EQ(read.origin.scenario_yaml, sample_origin().scenario_yaml);
    EXPECT_EQ(read.log_std, sample(actions).log_std);
  }
  Manifest greedy = sample(ActionKind::discrete);
  greedy.origin.selection = ActionSelection::greedy;
  EXPECT_EQ(parse_manifest(text_of(greedy), "manifest.json").origin.selection, ActionSelection::greedy);
}

/// What is said to a manifest in which `from` became `to`.
std::string manifest_refusal(const std::string& from, const std::string& to) {
  std::string text = text_of(sample(ActionKind::continuous));
  const size_t at = text.find(from);
  GIGA_CHECK(at != std::string::npos, from);
  text.replace(at, from.size(), to);
  return input_error_of([&] { parse_manifest(text, "manifest.json"); });
}

TEST(ExportManifest, MistakesAreSaidWithTheirPlace) {
  EXPECT_TRUE(contains(manifest_refusal("\"gigastep policy\"", "\"x\""),
                       {"manifest.json:2:11: kind: '\"x\"'", "gigastep policy"}));
  EXPECT_TRUE(contains(manifest_refusal("\"format_version\": 2", "\"format_version\": 1"),
                       {"manifest.json has format version 1, older than 2", "use gigastep ", "or export again"}));
  EXPECT_TRUE(contains(manifest_refusal("\"format_version\": 2", "\"format_version\": 3"),
                       {"manifest.json has format version 3, newer than 2", "use gigastep "}));
  EXPECT_TRUE(contains(manifest_refusal("\"gelu\"", "\"gel\""), {"activation: '\"gel\"'", "tanh"}));
  EXPECT_TRUE(contains(manifest_refusal("[12, 10]", "[12, 0]"), {"hidden[1]: '0'", "[1, 16384]"}));
  EXPECT_TRUE(contains(manifest_refusal("[12, 10]", "[]"), {"hidden"}));
  EXPECT_TRUE(contains(manifest_refusal("\"layer_norm\": true,", ""), {"layer_norm: is missing"}));
  EXPECT_TRUE(
      contains(manifest_refusal("\"sampled\"", "\"sample\""), {"action_selection: '\"sample\"'", "sampled, greedy"}));
  EXPECT_TRUE(contains(manifest_refusal("[-0.5, 0.25, -1]", "[-0.5, .nan, -1]"), {"log_std[1]"}));
  EXPECT_TRUE(contains(manifest_refusal("[-0.5, 0.25, -1]", "[-0.5]"), {"log_std"}));
  EXPECT_TRUE(
      contains(manifest_refusal("\"training\": {", "\"training\": 3, \"other\": {"), {"training: a map is needed"}));
  EXPECT_TRUE(contains(manifest_refusal("\"first\": 9", "\"first\": -9"), {"first: '-9'"}));
  EXPECT_TRUE(contains(input_error_of([] { parse_manifest("[1]", "manifest.json"); }), {"is no manifest"}));
}

TEST(ExportManifest, ADifferenceInTheLayoutIsNamed) {
  const Manifest manifest = sample(ActionKind::discrete);
  const SimSpec same = small_spec(ActionKind::discrete);
  const auto manifest_refusal = [&](const SimSpec& spec) {
    return input_error_of([&] { check_fits(interface_of(manifest), spec, "p"); });
  };
  EXPECT_EQ(manifest_refusal(same), "no error");
  SimSpec without = same;
  without.params.waypoints = false;
  without.finish();
  EXPECT_EQ(
      manifest_refusal(without),
      "p was trained in 'small', where an agent observes 49 numbers: self 1 x 9, neighbors 3 x 9, waypoint 1 x 5, "
      "boxes 2 x 4; in 'small' it observes 44 numbers: self 1 x 9, neighbors 3 x 9, boxes 2 x 4");
  SimSpec fewer = same;
  fewer.maps[0].boxes.clear();
  fewer.finish();
  EXPECT_TRUE(
      contains(manifest_refusal(fewer), {"it observes 41 numbers: self 1 x 9, neighbors 3 x 9, waypoint 1 x 5"}));
}

}  // namespace
}  // namespace giga::test
