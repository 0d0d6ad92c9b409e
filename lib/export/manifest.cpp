// Writing and reading manifests.
#include "export/manifest.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "scenario/scenario.hpp"
#include "sim/egocentric_view.hpp"
#include "sim/image_rows.hpp"
#include "sim/movement.hpp"

namespace giga {
namespace {

template <Enumeration T>
std::string name_of(T value) {
  return FieldCodec<T>::print(value);
}

Json architecture_json(const PolicyShape& shape, Precision precision) {
  Json json{{"hidden", shape.network.hidden},
            {"activation", name_of(shape.network.activation)},
            {"layer_norm", shape.network.layer_norm},
            {"layer_norm_epsilon", kLayerNormEpsilon},
            {"memory", name_of(shape.memory)},
            {"memory_size", shape.memory_size},
            {"normalizes_observations", shape.normalizes},
            {"normalized_limit", kNormalizedLimit},
            {"training_precision", name_of(precision)},
            {"training_arithmetic", cat("on a GPU: ", meaning_of(precision), "; on a CPU: fp32")}};
  if (!shape.reads_image()) return json;
  json["encoder"] = name_of(shape.image.kind);
  json["image_side"] = shape.image.side;
  if (shape.image.kind == EncoderKind::impala) json["impala_width"] = shape.image.impala_width;
  return json;
}

/// Feature j of the items of a block is obs[start:stop:step].
Json block_json(const ObservationBlock& block) {
  Json features = Json::array();
  int start = block.first;
  for (const FeatureText& feature : block.features)
    features.push_back(
        {{"name", feature.name}, {"slice", {start++, block.end(), block.size}}, {"meaning", feature.meaning}});
  return {{"name", block.name}, {"first", block.first},     {"count", block.count},
          {"size", block.size}, {"meaning", block.meaning}, {"features", std::move(features)}};
}

Json observation_json(const Manifest& manifest) {
  const int side = manifest.shape.image.side;
  if (side > 0)
    return {{"input", kImageInput},
            {"type", "uint8"},
            {"size", manifest.shape.row()},
            {"shape", {side, side, kChannels}},
            {"layout",
             "the image of the agent (gigastep's docs/rules.md, 8.3): pixel [x, y], then red, green, blue; y "
             "is up"},
            {"blocks", Json::array()}};
  Json blocks = Json::array();
  for (const ObservationBlock& block : manifest.observation) blocks.push_back(block_json(block));
  return {{"input", kRowInput},
          {"type", "float32"},
          {"size", manifest.shape.row()},
          {"layout", "item k of a block begins at first + k * size; a feature of all items is obs[start:stop:step]"},
          {"blocks", std::move(blocks)}};
}

constexpr const char* kInside = "egocentric_view_inside";
constexpr const char* kInsideMeaning =
    "the policy computes what it reads of the egocentric view (gigastep's docs/rules.md, 7.5) from the observation, "
    "for "
    "maps of limit_x by limit_y: agents and their kinds (as bits of `sprite`), the waypoint and the boxes of the "
    "observation. What the observation leaves out, such as images and agents beyond its items, the view does not tell "
    "either. The one difference is rounding: places in the observation are shares of the map in fp32, so a bearing is "
    "exact to some 1e-7 of the map's side divided by the distance";

Json view_json(const RowView& view) {
  return {{"meaning", kInsideMeaning}, {"neighbors", view.neighbors},          {"waypoint", view.waypoint},
          {"boxes", view.boxes},       {"numbers_of_a_box", view.box_numbers}, {"limit_x", view.limit_x},
          {"limit_y", view.limit_y},   {"opponents", view.opponents},          {"team_mates", view.team_mates},
          {"kinds", view.kinds}};
}

/// What goes from one step of an agent to its next; of size 0 without memory.
Json state_json(const PolicyShape& shape) {
  Json json{{"size", shape.state_size()}};
  if (shape.memory == MemoryKind::none) return json;
  const int h = shape.memory_size;
  json["input"] = kStateInput;
  json["output"] = kStateOutput;
  json["type"] = "float32";
  json["rule"] =
      "each agent has its own: zeros at the first step of each episode, then what came out at the step before";
  json["parts"] = Json::array({{{"name", "h"}, {"slice", {0, h}}}});
  if (shape.memory == MemoryKind::lstm) json["parts"].push_back({{"name", "c"}, {"slice", {h, 2 * h}}});
  return json;
}

constexpr const char* kControls[kActionSize][2] = {
    {"heading", "-1 turns clockwise, 1 counterclockwise, by 4 rad/s"},
    {"dive", "-1 descends, 1 climbs, by 5 units of altitude a second"},
    {"throttle", "-1 slows down, 1 speeds up, by 1.5 units/s^2 times the thrust of the agent's type"},
};

Json discrete_actions() {
  Json table = Json::array();
  for (int action = 0; action < kNDiscreteActions; ++action) {
    const Controls c = discrete_controls(action);
    const double values[kActionSize] = {c.heading, c.dive, c.throttle};
    Json row{{"index", action}};
    for (int k = 0; k < kActionSize; ++k) row[kControls[k][0]] = values[k];
    table.push_back(std::move(row));
  }
  return table;
}

Json action_json(const Manifest& manifest) {
  const bool discrete = manifest.shape.actions == ActionKind::discrete;
  Json controls = Json::array();
  for (const auto& [name, meaning] : kControls) controls.push_back({{"name", name}, {"meaning", meaning}});
  Json json{{"kind", name_of(manifest.shape.actions)},
            {"output", manifest.shape.output_name()},
            {"size", manifest.shape.outputs()},
            {"rule", discrete ? "the action is an index drawn from softmax(logits), or their argmax"
                              : "the action is tanh(mean + exp(log_std) * normal), or tanh(mean)"},
            {"steps_per_second", std::lround(1 / kDt)},
            {"controls", std::move(controls)}};
  if (discrete) {
    json["table"] = discrete_actions();
  } else {
    json["log_std"] = manifest.log_std;
  }
  return json;
}

/// Reads members of maps of the file, each needed; what is wrong is collected.
class MemberReader {
 public:
  explicit MemberReader(Errors& errors) : errors_(errors) {}

  /// A map inside a map; null where there is none.
  const Node* map(const Node* in, const std::string& key) { return child(in, key, &Node::is_map, "a map"); }
  const Node* sequence(const Node* in, const std::string& key) { return child(in, key, &Node::is_sequence, "a list"); }
  void wrong(const Node& node, const std::string& message) { errors_.add(node.at, message); }
  template <class T>
  void value(const Node* in, const std::string& key, T& value, const Allowed& allowed = {}) {
    if (const Node* node = find(in, key)) FieldCodec<T>::read(*node, value, allowed, {key, errors_});
  }

 private:
  const Node* find(const Node* in, const std::string& key) {
    const Node* node = in ? in->find(key) : nullptr;
    if (in && !node) errors_.add(in->at, cat(key, ": is missing"));
    return node;
  }
  const Node* child(const Node* in, const std::string& key, bool (Node::*is)() const, const char* needed) {
    const Node* node = find(in, key);
    if (!node || (node->*is)()) return node;
    errors_.add(node->at, cat(key, ": ", needed, " is needed here"));
    return nullptr;
  }

  Errors& errors_;
};

constexpr int kMostNumbers = 40'000'000;  // of an observation; kMaxGridAgents agents have 9 each

void read_observation(const Node* node, MemberReader& in, Manifest& manifest) {
  int size = 0;
  in.value(node, "size", size, range(1, kMostNumbers));
  const std::optional<RowView>& inside = manifest.shape.view;
  manifest.shape.inputs = inside ? inside->size() : size;
  if (node && inside && inside->row_size() != size)
    in.wrong(*node, cat("size: ", size, "; the ", kInside, " is of observations of ", inside->row_size(), " numbers"));
  if (const int side = manifest.shape.image.side; node && side > 0 && size != image_bytes(side))
    in.wrong(*node,
             cat("size: ", size, "; images of ", side, " x ", side, " pixels have ", image_bytes(side), " bytes"));
  const Node* blocks = in.sequence(node, "blocks");
  if (!blocks) return;
  RowView told;  // what the blocks say of the row
  for (const Node& item : blocks->items) {
    ObservationBlock& block = manifest.observation.emplace_back();
    in.value(&item, "name", block.name);
    in.value(&item, "first", block.first, range(0, kMostNumbers));
    in.value(&item, "count", block.count, range(1, kMostNumbers));
    in.value(&item, "size", block.size, range(1, kMostNumbers));
    if (block.name == "neighbors") told.neighbors = block.count;
    if (block.name == "waypoint") told.waypoint = true;
    if (block.name != "boxes") continue;
    told.boxes = block.count;
    told.box_numbers = block.size;
  }
  if (inside && (told.neighbors != inside->neighbors || told.waypoint != inside->waypoint ||
                 told.boxes != inside->boxes || (told.boxes > 0 && told.box_numbers != inside->box_numbers)))
    in.wrong(*blocks, cat("blocks: not those of the ", kInside));
}

void read_view(const Node* node, MemberReader& in, Manifest& manifest) {
  RowView& view = manifest.shape.view.emplace();
  in.value(node, "neighbors", view.neighbors, range(0, kMaxGridAgents - 1));
  in.value(node, "waypoint", view.waypoint);
  in.value(node, "boxes", view.boxes, range(0, kMostNumbers / 6));
  in.value(node, "numbers_of_a_box", view.box_numbers, range(4, 6));
  in.value(node, "limit_x", view.limit_x, greater_than(0));
  in.value(node, "limit_y", view.limit_y, greater_than(0));
  in.value(node, "opponents", view.opponents, range(0, kViewOpponents));
  in.value(node, "team_mates", view.team_mates, range(0, kViewTeamMates));
  in.value(node, "kinds", view.kinds);
}

void read_architecture(const Node* node, MemberReader& in, Manifest& manifest) {
  MlpConfig& network = manifest.shape.network;
  in.value(node, "hidden", network.hidden, range(1, 16384).items(1, 16));
  in.value(node, "activation", network.activation);
  in.value(node, "layer_norm", network.layer_norm);
  in.value(node, "normalizes_observations", manifest.shape.normalizes);
  // Manifests of before memory have none of it.
  if (node && node->find("memory")) in.value(node, "memory", manifest.shape.memory);
  if (manifest.shape.memory != MemoryKind::none)
    in.value(node, "memory_size", manifest.shape.memory_size, range(1, 4096));
  in.value(node, "training_precision", manifest.origin.precision);
  if (!node || !node->find("encoder")) return;  // it reads numbers
  ImageEncoderShape& image = manifest.shape.image;
  in.value(node, "encoder", image.kind);
  if (!reads_images(image.kind)) return;
  in.value(node, "image_side", image.side, range(image.kind == EncoderKind::nature ? kNatureSide : 8, 512));
  if (image.kind == EncoderKind::impala) in.value(node, "impala_width", image.impala_width, range(1, 512));
}

void read_training(const Node* node, MemberReader& in, Manifest& manifest) {
  PolicyOrigin& origin = manifest.origin;
  in.value(node, "scenario", origin.scenario_name);
  in.value(node, "rules", manifest.rules);
  in.value(node, "team", origin.team, range(0, kNTeams - 1));
  in.value(node, "seed", origin.seed);
  in.value(node, "updates", origin.updates, at_least(0));
  in.value(node, "agent_steps", origin.agent_steps, at_least(0));
  in.value(node, "scenario_yaml", origin.scenario_yaml);
  in.value(node, "config_yaml", origin.config_yaml);
}

Manifest read_root(const Node& root, MemberReader& in) {
  Manifest manifest;
  in.value(&root, "gigastep_version", manifest.origin.gigastep_version);
  in.value(&root, "format", manifest.format);
  read_architecture(in.map(&root, "architecture"), in, manifest);
  if (root.find(kInside)) read_view(in.map(&root, kInside), in, manifest);
  read_observation(in.map(&root, "observation"), in, manifest);
  in.value(&root, "action_selection", manifest.origin.selection);
  const Node* action = in.map(&root, "action");
  in.value(action, "kind", manifest.shape.actions);
  if (manifest.shape.actions == ActionKind::continuous)
    in.value(action, "log_std", manifest.log_std, range(-100, 100).items(kActionSize, kActionSize));
  read_training(in.map(&root, "training"), in, manifest);
  return manifest;
}

Manifest manifest_of(const Document& document, Errors& errors) {
  errors.throw_if_any();
  const Node& root = document.root;
  if (!root.is_map()) throw InputError(cat(document.name, " is no manifest: a JSON object is needed"));
  MemberReader in(errors);
  std::string kind;
  int version = 0;
  in.value(&root, "kind", kind, one_of({kManifestKind}));
  in.value(&root, "format_version", version, at_least(1));
  errors.throw_if_any();
  if (version != kManifestFormat) {
    std::string writer;
    in.value(&root, "gigastep_version", writer);
    errors.throw_if_any();
    const bool newer = version > kManifestFormat;
    throw InputError(cat(document.name, " has format version ", version, newer ? ", newer than " : ", older than ",
                         kManifestFormat, ", which this gigastep reads: use gigastep ", writer, ", which wrote it",
                         newer ? "" : ", or export again"));
  }
  Manifest manifest = read_root(root, in);
  errors.throw_if_any();
  return manifest;
}

}  // namespace

const char* policy_file_name(ExportFormat format) {
  constexpr const char* kNames[] = {"policy.safetensors", "policy.onnx", "policy.pt"};
  return kNames[static_cast<size_t>(format)];
}

std::string manifest_text(const Manifest& manifest, const Json* ratings) {
  const PolicyOrigin& origin = manifest.origin;
  Json json{{"kind", kManifestKind},
            {"format_version", kManifestFormat},
            {"gigastep_version", origin.gigastep_version},
            {"format", name_of(manifest.format)},
            {"file", policy_file_name(manifest.format)},
            {"architecture", architecture_json(manifest.shape, origin.precision)},
            {"observation", observation_json(manifest)},
            {"action", action_json(manifest)},
            {"state", state_json(manifest.shape)},
            {"action_selection", name_of(origin.selection)},
            {"ratings", ratings ? *ratings : Json::object()},
            {"training",
             {{"scenario", origin.scenario_name},
              {"rules", name_of(manifest.rules)},
              {"team", origin.team},
              {"seed", origin.seed},
              {"updates", origin.updates},
              {"agent_steps", origin.agent_steps},
              {"scenario_yaml", origin.scenario_yaml},
              {"config_yaml", origin.config_yaml}}}};
  if (manifest.shape.view) json[kInside] = view_json(*manifest.shape.view);
  return json_text(json);
}

Manifest parse_manifest(std::string_view text, const std::string& name) {
  Errors errors;
  return manifest_of(parse_yaml_text(text, name, errors), errors);  // JSON is YAML
}

Manifest read_manifest(const std::filesystem::path& file) {
  Errors errors;
  return manifest_of(parse_yaml_file(file, errors), errors);
}

PolicyInterface interface_of(const Manifest& manifest) {
  return {manifest.origin.scenario_name, manifest.shape.actions, manifest.shape.row(), manifest.observation,
          manifest.shape.image.side};
}

}  // namespace giga
