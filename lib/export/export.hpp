// Exported policies: a folder with the policy in a format that other programs read, its manifest and an example; and
// reading them back to play.
#pragma once

#include <filesystem>
#include <optional>

#include "core/memory.hpp"
#include "export/manifest.hpp"
#include "export/read_policy.hpp"

namespace giga {

class Actor;

constexpr const char* kExampleName = "act.py";

/// Where the egocentric view comes from that a policy reads.
enum class ViewPlace : uint8_t {
  inside,  ///< the policy computes it from the vector observation, and takes that alone
  input,   ///< it is part of the policy's observation
};
constexpr std::array<const char*, 2> enum_names(ViewPlace) { return {"inside", "input"}; }

struct ExportOptions {
  ViewPlace view = ViewPlace::inside;
  const Json* ratings = nullptr;  ///< an object for the manifest
};

/// A scenario as those see it who are not given the egocentric view.
SimSpec without_view(const SimSpec& spec);

/// Writes policy.*, act.py and, last, manifest.json into a folder that does not exist or is
/// empty; InputError where it is not or cannot be made. Where something fails nothing is left behind.
void write_export(const std::filesystem::path& folder, ExportFormat format, const Actor& actor, const SimSpec& spec,
                  const PolicyOrigin& origin, const ExportOptions& options = {});

/// Whether a path is that of an exported policy: the folder of an export (also without its manifest, which
/// find_exported_policy tells), a file named like a policy (.safetensors, .onnx, .pt), or a ZIP archive, which is what
/// TorchScript modules are.
bool is_exported_policy(const std::filesystem::path& path);

/// What there is to know of an exported policy before it plays.
struct ExportedPolicy {
  std::filesystem::path file;  ///< with the policy itself
  ExportFormat format = ExportFormat::safetensors;
  std::optional<Manifest> manifest;  ///< none: a TorchScript module from elsewhere
};

/// Finds the policy in the folder of an export or in a policy file, and reads its manifest. A folder and a safetensors
/// file need one. A TorchScript module, which is code, is admitted only with `trust`; it may come from elsewhere and
/// have no manifest. Throws InputError with the file and what is wrong with it, and for ONNX, which is not read.
ExportedPolicy find_exported_policy(const std::filesystem::path& path, bool trust);

/// The policy for a scenario; nothing in the files is executed but a TorchScript module (see open_torchscript). Throws
/// InputError where the file is damaged or the scenario's observations or actions are others.
ReadPolicy read_exported_policy(const ExportedPolicy& exported, const SimSpec& spec, Device device);

}  // namespace giga
