// Manifest: what an exported policy is, where it is from, and what goes in and comes out: manifest.json beside it.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "export/observation_layout.hpp"
#include "export/policy_model.hpp"
#include "io/json.hpp"

namespace giga {

enum class ExportFormat : uint8_t { safetensors, onnx, torchscript };
constexpr std::array<const char*, 3> enum_names(ExportFormat) { return {"safetensors", "onnx", "torchscript"}; }

/// "policy.safetensors", "policy.onnx", "policy.pt".
const char* policy_file_name(ExportFormat format);
constexpr const char* kManifestName = "manifest.json";
/// How graphs name what goes in: a row of numbers, or an image.
constexpr const char *kRowInput = "obs", *kImageInput = "image";
/// How graphs name what a policy with memory remembers.
constexpr const char *kStateInput = "state", *kStateOutput = "next_state";
constexpr const char* kManifestKind = "gigastep policy";
constexpr int kManifestFormat = 2;  // 1 named parts of observations otherwise

/// How its training took actions from a policy: drawn by their probabilities, or the most likely ones.
enum class ActionSelection : uint8_t { sampled, greedy };
constexpr std::array<const char*, 2> enum_names(ActionSelection) { return {"sampled", "greedy"}; }

/// The training that a policy is from.
struct PolicyOrigin {
  std::string gigastep_version;  ///< of the program that wrote the export
  std::string scenario_name, scenario_yaml;
  std::string config_yaml;
  int team = 0;
  uint64_t seed = 0;
  int64_t updates = 0, agent_steps = 0;
  Precision precision = Precision::fp32;  ///< of matrix products on the GPU; the tensors are fp32
  ActionSelection selection = ActionSelection::sampled;
};

struct Manifest {
  ExportFormat format = ExportFormat::safetensors;
  PolicyShape shape;
  std::vector<ObservationBlock> observation;  ///< what the policy takes: without a view that it computes
  Rules rules = Rules::corrected;
  std::vector<float> log_std;  ///< [3]; empty for discrete actions
  PolicyOrigin origin;
};

/// As JSON, with the meaning of every number of an observation and of every action in words. `ratings`: an object,
/// where the policy has some.
std::string manifest_text(const Manifest& manifest, const Json* ratings = nullptr);

/// The manifest in a text; `name` stands for the file in messages. Throws InputError with all that is missing or wrong.
/// Keys that are not known are passed over.
Manifest parse_manifest(std::string_view text, const std::string& name);
/// The same of a file, of at most 4 MiB.
Manifest read_manifest(const std::filesystem::path& file);

/// For check_fits().
PolicyInterface interface_of(const Manifest& manifest);

}  // namespace giga
