// Exported policies: a folder with the policy in a format that other programs read, its manifest and an example; and
// reading them back to play.
#pragma once

#include <filesystem>
#include <memory>

#include "core/memory.hpp"
#include "export/manifest.hpp"
#include "policy/actor.hpp"
#include "policy/policy.hpp"

namespace giga {

constexpr const char* kExampleName = "act.py";

/// Writes policy.*, act.py and, last, manifest.json into a folder that does not exist or is empty; InputError where it
/// is not or cannot be made. Where something fails nothing is left behind.
void write_export(const std::filesystem::path& folder, ExportFormat format, const Actor& actor, const SimSpec& spec,
                  const PolicyOrigin& origin);

/// Whether a path is to be read with read_exported_policy: the folder of an export, or a file named like a policy
/// (.safetensors, .onnx, .pt).
bool is_exported_policy(const std::filesystem::path& path);

/// The policy in the folder of an export or in a policy file, for a scenario; nothing in them is executed. A
/// safetensors file needs its manifest beside it. A TorchScript module, which is code, is opened only with `trust`; it
/// may come from elsewhere and have no manifest (see open_torchscript). Throws InputError with the file and what is
/// wrong with it, where the scenario's observations or actions are others, and for ONNX, which is not read.
std::unique_ptr<Policy> read_exported_policy(const std::filesystem::path& path, const SimSpec& spec, Device device,
                                             bool trust);

}  // namespace giga
