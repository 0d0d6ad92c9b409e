// What a checkpoint file holds, and where in it.
#include "io/checkpoint.hpp"

#include <algorithm>
#include <vector>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/hdf5_file.hpp"
#include "io/hdf5_reader.hpp"
#include "io/seal.hpp"

namespace giga {
namespace {

constexpr const char* kArrays = "arrays/";

NamedArray text_array(const std::string& text) {
  return make_array<uint8_t>("", std::vector<uint8_t>(text.begin(), text.end()));
}
std::string text_of(const NamedArray& array) {
  const std::vector<uint8_t> bytes = array_values<uint8_t>(array);
  return {bytes.begin(), bytes.end()};
}

/// The names of the arrays in their order, a line each: an array that is gone is noticed.
std::string names_text(const NamedArrays& arrays) {
  std::string text;
  for (const NamedArray& a : arrays) text += a.name + "\n";
  return text;
}
std::vector<std::string> split_lines(const std::string& text) {
  std::vector<std::string> lines;
  for (size_t at = 0; at < text.size();) {
    const size_t end = std::min(text.find('\n', at), text.size());
    lines.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return lines;
}

void write_cursor(hid_t file, const RunCursor& c) {
  hdf5::write_attribute(file, "seconds", c.seconds);
  hdf5::write_attribute(file, "metrics_bytes", c.metrics_bytes);
  hdf5::write_attribute(file, "events_bytes", c.events_bytes);
  hdf5::write_attribute(file, "best_score", c.best_score);
  hdf5::write_attribute(file, "best_updates", c.best_updates);
}
RunCursor read_cursor(const hdf5::Reader& file) {
  RunCursor c;
  c.seconds = file.float_attribute("seconds");
  c.metrics_bytes = file.uint_attribute("metrics_bytes");
  c.events_bytes = file.uint_attribute("events_bytes");
  c.best_score = file.float_attribute("best_score");
  c.best_updates = file.int_attribute("best_updates");
  return c;
}

Checkpoint decode(std::string_view bytes) {
  if (const std::string reason = broken_seal(bytes, kCheckpointKind, kCheckpointFormat); !reason.empty())
    throw hdf5::FormatError(reason);
  const hdf5::Reader file(bytes, kSealBytes);
  Checkpoint c;
  c.format_version = static_cast<int>(file.int_attribute("format_version"));
  c.gigastep_version = file.text_attribute("gigastep_version");
  c.scenario_name = file.text_attribute("scenario_name");
  c.updates = file.int_attribute("updates");
  c.agent_steps = file.int_attribute("agent_steps");
  c.seed = file.uint_attribute("seed");
  c.cursor = read_cursor(file);
  // No part of the file is read twice, so that all parts together are no larger than the file.
  size_t left = bytes.size();
  const auto read = [&file, &left](const std::string& path) {
    NamedArray array = file.dataset(path, left);
    left -= array.bytes.size();
    return array;
  };
  const std::string names = text_of(read("array_names"));
  c.config_yaml = text_of(read("config_yaml"));
  c.scenario_yaml = text_of(read("scenario_yaml"));
  for (const std::string& name : split_lines(names)) {
    c.arrays.push_back(read(kArrays + name));
    c.arrays.back().name = name;
  }
  return c;
}

}  // namespace

std::string encode_checkpoint(const Checkpoint& c) {
  const hdf5::QuietErrors quiet;
  const hdf5::Handle file = hdf5::create_file(kSealBytes);
  const std::string names = names_text(c.arrays);
  hdf5::write_attribute(file, "kind", c.kind);
  hdf5::write_attribute(file, "format_version", static_cast<int64_t>(c.format_version));
  hdf5::write_attribute(file, "gigastep_version", c.gigastep_version);
  hdf5::write_attribute(file, "scenario_name", c.scenario_name);
  hdf5::write_attribute(file, "updates", c.updates);
  hdf5::write_attribute(file, "agent_steps", c.agent_steps);
  hdf5::write_attribute(file, "seed", c.seed);
  write_cursor(file, c.cursor);
  hdf5::write_dataset(file, "array_names", text_array(names));
  hdf5::write_dataset(file, "config_yaml", text_array(c.config_yaml));
  hdf5::write_dataset(file, "scenario_yaml", text_array(c.scenario_yaml));
  for (const NamedArray& array : c.arrays) {
    GIGA_CHECK(!array.name.empty() && array.name.find('\n') == std::string::npos, "an array named '", array.name, "'");
    hdf5::write_dataset(file, kArrays + array.name, array);
  }
  std::string bytes = hdf5::file_bytes(file, kSealBytes);
  seal(bytes, c.kind, c.format_version, c.gigastep_version);
  return bytes;
}

Checkpoint decode_checkpoint(std::string_view bytes, const std::string& name) {
  try {
    return decode(bytes);
  } catch (const hdf5::FormatError& e) {
    throw InputError(cat(name, ": ", e.what()));
  }
}

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint) {
  write_file(path, encode_checkpoint(checkpoint));
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
  return decode_checkpoint(read_file(path), path.string());
}

}  // namespace giga
