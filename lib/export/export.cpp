#include "export/export.hpp"

#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <optional>
#include <system_error>
#include <vector>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "export/actor_model.hpp"
#include "export/example.hpp"
#include "export/onnx.hpp"
#include "export/safetensors.hpp"
#include "export/torchscript.hpp"
#include "io/files.hpp"
#include "policy/actor.hpp"

#include "sim/row_layout.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr uintmax_t kMostFileBytes = uintmax_t{4} << 30;

std::string encode(const PolicyModel& model, ExportFormat format, const std::string& gigastep_version) {
  switch (format) {
    case ExportFormat::safetensors:
      return encode_safetensors(model.tensors, {{"written_by", "gigastep " + gigastep_version}});
    case ExportFormat::onnx:
      return encode_onnx(model, gigastep_version);
    case ExportFormat::torchscript:
      return encode_torchscript(model);
  }
  throw Error("an export format without a writer");
}

/// The functions of act.py that make what the dense layers take of an observation; t: the policy's tensors.
std::string input_functions(const PolicyShape& shape) {
  if (shape.reads_image())
    return cat(example_part("images").value(), "\n\ndef network_input(image, t):\n",
               "    \"\"\"What the convolutions make of images [B, side, side, 3].\"\"\"\n",
               python_convolutions(shape.image, "image", false, "    "), "    return x\n");
  if (!shape.view) return "def network_input(obs, t):\n    return obs\n";
  PythonWriter writer("np", "    ");
  const Array row = with_view(*shape.view, {&writer, "obs"});
  return cat("def network_input(obs, t):\n",
             "    \"\"\"The observation and, behind it, the egocentric view, which is computed from it.\"\"\"\n",
             writer.code(), "    return ", row.text, "\n");
}

std::string example_of(ExportFormat format, const PolicyShape& shape) {
  const auto part = [](const std::string& name) {
    const auto text = example_part(name);
    GIGA_CHECK(text, "no part ", name, " of the example");
    return std::string(*text);
  };
  const bool reads_tensors = format == ExportFormat::safetensors;
  return part(FieldCodec<ExportFormat>::print(format)) + "\n\n" +
         (reads_tensors ? input_functions(shape) + "\n\n" : "") + part("act");
}

/// Makes the folder; true where it was not there.
bool make_empty_folder(const fs::path& folder) {
  std::error_code code;
  if (fs::exists(folder, code) && !fs::is_directory(folder, code))
    throw InputError(cat(folder.string(), " is a file; an export is a folder of its own"));
  const bool made = fs::create_directories(folder, code);
  if (code) throw InputError(cat("cannot create the folder ", folder.string(), ": ", code.message()));
  if (!made && !fs::is_empty(folder, code))
    throw InputError(code ? cat("cannot read the folder ", folder.string(), ": ", code.message())
                          : cat("the folder ", folder.string(), " is not empty; an export needs one of its own"));
  if (::access(folder.c_str(), W_OK) != 0)
    throw InputError(cat("cannot write into the folder ", folder.string(), ": ", std::strerror(errno)));
  return made;
}

struct OutputFile {
  std::string name, bytes;
};

/// All files or none.
void write_all(const fs::path& folder, const std::vector<OutputFile>& files) {
  const bool made = make_empty_folder(folder);
  try {
    for (const OutputFile& file : files) write_file(folder / file.name, file.bytes);
  } catch (...) {
    std::error_code code;
    for (const OutputFile& file : files) fs::remove(folder / file.name, code);
    if (made) fs::remove(folder, code);
    throw;
  }
}

std::string read_policy_file(const fs::path& file) {
  std::error_code code;
  const uintmax_t size = fs::file_size(file, code);
  if (!code && size > kMostFileBytes)
    throw InputError(cat(file.string(), " has ", size, " bytes; a policy has at most ", kMostFileBytes));
  return read_file(file);
}

ReadPolicy read_safetensors(const fs::path& file, const Manifest& manifest, const SimSpec& spec, Device device) {
  const PolicyModel model{manifest.shape, decode_safetensors(read_policy_file(file), file.string())};
  check_tensors(model, file.string());
  const Precision precision = device.is_cuda() ? manifest.origin.precision : Precision::fp32;
  const auto actor = [&](int row) { return std::make_shared<Actor>(actor_of(model, row, precision, device)); };
  const std::optional<RowView>& inside = manifest.shape.view;
  if (manifest.shape.reads_image()) return {actor(manifest.shape.inputs)};
  // Where the simulator computes the same view, its numbers are taken: they are those of the training to the last bit.
  if (!inside || row_view(spec) == inside) return {actor(observation_rows(spec).stride())};
  RowView here = *inside;
  here.limit_x = spec.params.limit_x;
  here.limit_y = spec.params.limit_y;
  return {with_view_inside(actor(here.size()), here, device)};
}

/// Whether a file begins like a ZIP archive.
bool is_zip(const fs::path& file) {
  char head[4] = {};
  std::ifstream(file, std::ios::binary).read(head, sizeof head);
  return std::string_view(head, sizeof head) == "PK\x03\x04";
}

constexpr std::array kFormats = {ExportFormat::safetensors, ExportFormat::onnx, ExportFormat::torchscript};

/// That of the policy file in a folder, which may have lost its manifest.
std::optional<ExportFormat> format_in_folder(const fs::path& folder) {
  std::error_code code;
  for (const ExportFormat format : kFormats)
    if (fs::exists(folder / policy_file_name(format), code)) return format;
  return std::nullopt;
}

std::optional<ExportFormat> format_of_file(const fs::path& file) {
  for (const ExportFormat format : kFormats)
    if (file.extension() == fs::path(policy_file_name(format)).extension()) return format;
  if (is_zip(file)) return ExportFormat::torchscript;
  return std::nullopt;
}

}  // namespace

SimSpec without_view(const SimSpec& spec) {
  SimSpec seen = spec;
  seen.params.egocentric_view = false;
  return seen;
}

void write_export(const fs::path& folder, ExportFormat format, const Actor& actor, const SimSpec& spec,
                  const PolicyOrigin& origin, const ExportOptions& options) {
  const bool sees = actor.reads_image();
  const std::optional<RowView> inside = options.view == ViewPlace::inside && !sees ? row_view(spec) : std::nullopt;
  const PolicyModel model =
      model_of(actor, sees ? static_cast<int>(actor.inputs().size) : spec.observation_size(), inside);
  Manifest manifest{format, model.shape, {}, spec.params.rules, {}, origin};
  if (!sees) manifest.observation = observation_layout(inside ? without_view(spec) : spec);
  if (model.shape.actions == ActionKind::continuous)
    manifest.log_std = array_values<float>(find_array(model.tensors, kLogStdTensor));
  // The manifest comes last: a folder that has one is whole.
  write_all(folder, {{policy_file_name(format), encode(model, format, origin.gigastep_version)},
                     {kExampleName, example_of(format, model.shape)},
                     {kManifestName, manifest_text(manifest, options.ratings) + "\n"}});
}

bool is_exported_policy(const fs::path& path) {
  std::error_code code;
  if (fs::is_directory(path, code)) {
    // A run may have been exported into its own folder.
    const bool of_run = fs::exists(path / "checkpoints", code) || fs::exists(path / "config.yaml", code);
    return fs::exists(path / kManifestName, code) || (!of_run && format_in_folder(path));
  }
  return format_of_file(path).has_value();
}

ExportedPolicy find_exported_policy(const fs::path& path, bool trust) {
  std::error_code code;
  if (!fs::exists(path, code)) throw InputError(cat("there is no exported policy ", path.string()));
  const bool is_folder = fs::is_directory(path, code);
  const fs::path manifest_file = (is_folder ? path : path.parent_path()) / kManifestName;
  const bool has_manifest = fs::exists(manifest_file, code);
  const std::optional<ExportFormat> format = !is_folder     ? format_of_file(path)
                                             : has_manifest ? read_manifest(manifest_file).format
                                                            : format_in_folder(path);
  if (!format)
    throw InputError(cat(path.string(),
                         " is no exported policy: allowed are the folder of an export and files that "
                         "end in .safetensors or .pt"));
  ExportedPolicy found{is_folder ? path / policy_file_name(*format) : path, *format, {}};
  if (*format == ExportFormat::onnx)
    throw InputError(cat(found.file.string(),
                         " is an ONNX graph, which gigastep writes but does not read; export the policy "
                         "with --format safetensors to play it here"));
  if ((is_folder || *format == ExportFormat::safetensors) && !has_manifest)
    throw InputError(cat(found.file.string(), " has no ", kManifestName,
                         " beside it, which says what the policy observes and does: keep together what export wrote, "
                         "or export the policy again"));
  if (*format == ExportFormat::torchscript && !trust)
    throw InputError(cat(found.file.string(),
                         " is a TorchScript module, which is code: opening it runs what is in it, with "
                         "your rights; add --trust to eval, rate or record if you know where it is from; train and "
                         "exploit take policies that were exported with --format safetensors"));
  // A module from elsewhere may lie beside the manifest of something else, or of nothing.
  const bool exported_here = found.file.filename() == policy_file_name(*format) && has_manifest;
  if (is_folder || exported_here || *format == ExportFormat::safetensors) found.manifest = read_manifest(manifest_file);
  return found;
}

ReadPolicy read_exported_policy(const ExportedPolicy& exported, const SimSpec& spec, Device device) {
  const std::string file = exported.file.string();
  const std::optional<RowView> inside = exported.manifest ? exported.manifest->shape.view : std::nullopt;
  const SimSpec seen = inside ? without_view(spec) : spec;
  if (exported.manifest) check_fits(interface_of(*exported.manifest), seen, file);
  if (inside && exported.format == ExportFormat::torchscript &&
      (inside->limit_x != spec.params.limit_x || inside->limit_y != spec.params.limit_y))
    throw InputError(cat(file, " computes the egocentric view of maps of ", inside->limit_x, " x ", inside->limit_y,
                         "; those of '", spec.name, "' are ", spec.params.limit_x, " x ", spec.params.limit_y,
                         "; export the policy with --format safetensors or with --view input"));
  ReadPolicy read;
  if (exported.format == ExportFormat::safetensors)
    read = read_safetensors(exported.file, exported.manifest.value(), spec, device);
  else
    read = open_torchscript(read_policy_file(exported.file), file,
                            {seen.observation_size(), exported.manifest ? exported.manifest->shape.image.side : 0},
                            spec.params.actions, device);
  if (exported.manifest && exported.manifest->origin.selection == ActionSelection::greedy) read.greedy = true;
  return read;
}

}  // namespace giga
