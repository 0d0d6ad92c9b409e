// Writing and reading manifests.
#include "export/manifest.hpp"

#include <cmath>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "scenario/scenario.hpp"
#include "sim/movement.hpp"

namespace giga {
namespace {

template <Enumeration T>
std::string name_of(T value) {
  return FieldCodec<T>::print(value);
}

Json architecture_json(const PolicyShape& shape, Precision precision) {
  Json json = Json::object();
  json.set("hidden", Json::array(shape.network.hidden)).set("activation", name_of(shape.network.activation));
  json.set("layer_norm", shape.network.layer_norm).set("layer_norm_epsilon", static_cast<double>(kLayerNormEpsilon));
  json.set("normalizes_observations", shape.normalizes);
  json.set("normalized_limit", static_cast<double>(kNormalizedLimit)).set("training_precision", name_of(precision));
  json.set("training_arithmetic", cat("on a GPU: ", meaning_of(precision), "; on a CPU: fp32"));
  return json;
}

/// Feature j of the items of a block is obs[start:stop:step].
Json block_json(const ObservationBlock& block) {
  Json features = Json::array();
  int start = block.first;
  for (const ObservationFeature& feature : block_features(block.name, block.size))
    features.push(Json::object()
                      .set("name", feature.name)
                      .set("slice", Json::array(std::vector<int>{start++, block.end(), block.size}))
                      .set("meaning", feature.meaning));
  Json json = Json::object();
  json.set("name", block.name).set("first", block.first).set("count", block.count).set("size", block.size);
  json.set("meaning", block_meaning(block.name)).set("features", std::move(features));
  return json;
}

Json observation_json(const Manifest& manifest) {
  Json blocks = Json::array();
  for (const ObservationBlock& block : manifest.observation) blocks.push(block_json(block));
  Json json = Json::object();
  json.set("input", "obs").set("type", "float32").set("size", manifest.shape.inputs);
  json.set("layout", "item k of a block begins at first + k * size; a feature of all items is obs[start:stop:step]");
  return json.set("blocks", std::move(blocks));
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
    Json row = Json::object().set("index", action);
    for (int k = 0; k < kActionSize; ++k) row.set(kControls[k][0], values[k]);
    table.push(std::move(row));
  }
  return table;
}

Json action_json(const Manifest& manifest) {
  const bool discrete = manifest.shape.actions == ActionKind::discrete;
  Json controls = Json::array();
  for (const auto& [name, meaning] : kControls) controls.push(Json::object().set("name", name).set("meaning", meaning));
  Json json = Json::object();
  json.set("kind", name_of(manifest.shape.actions));
  json.set("output", manifest.shape.output_name()).set("size", manifest.shape.outputs());
  json.set("rule", discrete ? "the action is an index drawn from softmax(logits), or their argmax"
                            : "the action is tanh(mean + exp(log_std) * normal), or tanh(mean)");
  json.set("steps_per_second", static_cast<int>(std::lround(1 / kDt))).set("controls", std::move(controls));
  if (discrete) return json.set("table", discrete_actions());
  Json log_std = Json::array();
  for (const float value : manifest.log_std) log_std.push(static_cast<double>(value));
  return json.set("log_std", std::move(log_std));
}

/// Reads members of maps of the file, each needed; what is wrong is collected.
class MemberReader {
 public:
  explicit MemberReader(Errors& errors) : errors_(errors) {}

  /// A map inside a map; null where there is none.
  const Node* map(const Node* in, const std::string& key) { return child(in, key, &Node::is_map, "a map"); }
  const Node* sequence(const Node* in, const std::string& key) { return child(in, key, &Node::is_sequence, "a list"); }
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

constexpr int kMostNumbers = 1'000'000;  // of an observation; kMaxAgents agents have 9 each

void read_observation(const Node* node, MemberReader& in, Manifest& manifest) {
  in.value(node, "size", manifest.shape.inputs, range(1, kMostNumbers));
  const Node* blocks = in.sequence(node, "blocks");
  if (!blocks) return;
  for (const Node& item : blocks->items) {
    ObservationBlock& block = manifest.observation.emplace_back();
    in.value(&item, "name", block.name);
    in.value(&item, "first", block.first, range(0, kMostNumbers));
    in.value(&item, "count", block.count, range(1, kMostNumbers));
    in.value(&item, "size", block.size, range(1, kMostNumbers));
  }
}

void read_architecture(const Node* node, MemberReader& in, Manifest& manifest) {
  MlpConfig& network = manifest.shape.network;
  in.value(node, "hidden", network.hidden, range(1, 16384).items(1, 16));
  in.value(node, "activation", network.activation);
  in.value(node, "layer_norm", network.layer_norm);
  in.value(node, "normalizes_observations", manifest.shape.normalizes);
  in.value(node, "training_precision", manifest.origin.precision);
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
  if (version > kManifestFormat)
    throw InputError(
        cat(document.name, ": format_version is ", version, "; this gigastep reads up to ", kManifestFormat));
  Manifest manifest = read_root(root, in);
  errors.throw_if_any();
  return manifest;
}

}  // namespace

const char* policy_file_name(ExportFormat format) {
  constexpr const char* kNames[] = {"policy.safetensors", "policy.onnx", "policy.pt"};
  return kNames[static_cast<size_t>(format)];
}

Json manifest_json(const Manifest& manifest, Json ratings) {
  const PolicyOrigin& origin = manifest.origin;
  Json training = Json::object();
  training.set("scenario", origin.scenario_name).set("rules", name_of(manifest.rules)).set("team", origin.team);
  training.set("seed", origin.seed).set("updates", origin.updates).set("agent_steps", origin.agent_steps);
  training.set("scenario_yaml", origin.scenario_yaml).set("config_yaml", origin.config_yaml);
  Json json = Json::object();
  json.set("kind", kManifestKind).set("format_version", kManifestFormat);
  json.set("gigastep_version", origin.gigastep_version).set("format", name_of(manifest.format));
  json.set("file", policy_file_name(manifest.format));
  json.set("architecture", architecture_json(manifest.shape, origin.precision));
  json.set("observation", observation_json(manifest)).set("action", action_json(manifest));
  json.set("action_selection", name_of(origin.selection));
  return json.set("ratings", std::move(ratings)).set("training", std::move(training));
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
  return {manifest.origin.scenario_name, manifest.shape.actions, manifest.shape.inputs, manifest.observation};
}

}  // namespace giga
