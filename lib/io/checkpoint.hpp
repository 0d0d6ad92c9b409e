// Checkpoint: everything that a run needs to be evaluated or continued, as one HDF5 file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "core/named_array.hpp"

namespace giga {

constexpr int kCheckpointFormat = 3;  ///< others are refused: what they hold means something else
constexpr const char* kCheckpointKind = "gigastep checkpoint";

/// Where the files and the evaluation of a run stand, beside what it has learned.
struct RunCursor {
  double seconds = 0;          ///< of training so far, all processes together
  uint64_t metrics_bytes = 0;  ///< length of metrics.csv
  uint64_t events_bytes = 0;   ///< length of the TensorBoard events
  double best_score = -1;      ///< of the best evaluation so far; -1 = there was none
  int64_t best_updates = 0;    ///< updates that were done then
};

/// The file begins with a seal (seal.hpp). In the HDF5 part the numbers and short texts are attributes of the root, the
/// two YAML texts datasets `config_yaml` and `scenario_yaml`, the arrays datasets below `arrays/` under their own
/// names, little-endian and uncompressed; `array_names` lists them. Each dataset carries a CRC-32 (attribute `crc32`).
struct Checkpoint {
  int format_version = kCheckpointFormat;
  std::string kind = kCheckpointKind;
  std::string gigastep_version;  ///< of the program that wrote it
  std::string scenario_name;
  std::string config_yaml;    ///< resolved run config
  std::string scenario_yaml;  ///< resolved scenario
  int64_t updates = 0;
  int64_t agent_steps = 0;
  uint64_t seed = 0;
  RunCursor cursor;
  NamedArrays arrays;  ///< all learned state, and all that the next update depends on
};

/// The whole file or nothing (see write_file).
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint);

/// Throws InputError with the file and what is wrong: missing, not HDF5, no checkpoint, of another format, damaged.
Checkpoint read_checkpoint(const std::filesystem::path& path);

/// The same from and to the bytes of a file; `name` stands for it in messages.
std::string encode_checkpoint(const Checkpoint& checkpoint);
Checkpoint decode_checkpoint(std::string_view bytes, const std::string& name);

}  // namespace giga
