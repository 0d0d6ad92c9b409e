// TensorBoard's event files: TFRecords that hold `Event` messages. Field numbers are those of TensorBoard's
// event.proto, summary.proto, tensor.proto and, for hyper-parameters, plugins/hparams/{plugin_data,api}.proto.
#include "io/tensorboard.hpp"

#include <cmath>
#include <limits>
#include <utility>

#include "core/error.hpp"
#include "io/crc32c.hpp"
#include "io/protobuf_wire.hpp"

namespace giga {
namespace {

using Message = ProtobufMessage;

// Enumerations.
constexpr uint64_t kDataClassTensor = 2;
constexpr uint64_t kDtFloat = 1, kDtString = 7;
constexpr uint64_t kTypeString = 1, kTypeBool = 2, kTypeFloat64 = 3;
constexpr uint64_t kStatusSuccess = 1, kStatusFailure = 2;

/// A checksum as the format wants it: rotated and shifted, since a checksum over data that holds checksums says little.
std::string masked_checksum(std::string_view bytes) {
  const uint32_t crc = crc32c(bytes);
  return little_endian((crc >> 15 | crc << 17) + 0xA282EAD8u);
}

std::string record_of(const Message& event) {
  const std::string& data = event.encoded();
  const std::string length = little_endian(static_cast<uint64_t>(data.size()));
  return length + masked_checksum(length) + data + masked_checksum(data);
}

Message event_at(double wall_time, int64_t step) {
  return Message().float64(1, wall_time).varint(2, static_cast<uint64_t>(step));
}

/// A tensor of one axis with `size` elements, which the caller adds.
Message tensor_of(uint64_t type, uint64_t size) {
  return Message().varint(1, type).message(2, Message().message(2, Message().varint(1, size)));
}

/// An event with one value that belongs to a plugin.
Message plugin_event(double wall_time, int64_t step, const std::string& tag, const std::string& plugin,
                     const Message& content, const Message& tensor) {
  const Message plugin_data = Message().text(1, plugin).message(2, content);
  const Message metadata = Message().message(1, plugin_data).varint(4, kDataClassTensor);
  const Message value = Message().text(1, tag).message(8, tensor).message(9, metadata);
  return event_at(wall_time, step).message(5, Message().message(1, value));
}

/// What the HPARAMS tab reads stands in the plugin's data; the value itself is empty. `field` of HParamsPluginData: 2
/// Experiment, 3 SessionStartInfo, 4 SessionEndInfo.
Message hparams_event(double wall_time, const std::string& tag, int field, const Message& info) {
  return plugin_event(wall_time, 0, "_hparams_/" + tag, "hparams", Message().message(field, info),
                      tensor_of(kDtFloat, 0));
}

/// google.protobuf.Value, and HParamInfo.type.
std::pair<Message, uint64_t> value_and_type(const std::string& name, const HyperParameter& value) {
  if (const double* number = std::get_if<double>(&value)) {
    GIGA_CHECK(std::isfinite(*number), "hyper-parameter ", name, " = ", *number);
    return {Message().float64(2, *number), kTypeFloat64};
  }
  if (const bool* flag = std::get_if<bool>(&value)) return {Message().varint(4, *flag), kTypeBool};
  return {Message().text(3, std::get<std::string>(value)), kTypeString};
}

}  // namespace

TensorBoardEvents TensorBoardEvents::create(const std::filesystem::path& path, double wall_time) {
  TensorBoardEvents events(AppendFile::create(path));
  events.file_.append(record_of(Message().float64(1, wall_time).text(3, "brain.Event:2")));  // file_version
  return events;
}

TensorBoardEvents TensorBoardEvents::resume(const std::filesystem::path& path, uint64_t size) {
  return TensorBoardEvents(AppendFile::resume(path, size));
}

void TensorBoardEvents::hyper_parameters(const HyperParameters& values, const std::vector<std::string>& metric_tags,
                                         double wall_time) {
  Message experiment = Message().float64(3, wall_time);
  Message start;
  for (const auto& [name, parameter] : values) {
    const auto [value, type] = value_and_type(name, parameter);
    experiment.message(4, Message().text(1, name).varint(4, type));  // HParamInfo
    start.message(1, Message().text(1, name).message(2, value));     // an entry of a map is a message: key, value
  }
  for (const std::string& tag : metric_tags)
    experiment.message(5, Message().message(1, Message().text(2, tag)));  // MetricInfo, MetricName
  start.float64(5, wall_time);
  file_.append(record_of(hparams_event(wall_time, "experiment", 2, experiment)) +
               record_of(hparams_event(wall_time, "session_start_info", 3, start)));
}

void TensorBoardEvents::session_end(bool success, double wall_time) {
  const Message end = Message().varint(1, success ? kStatusSuccess : kStatusFailure).float64(2, wall_time);
  file_.append(record_of(hparams_event(wall_time, "session_end_info", 4, end)));
}

void TensorBoardEvents::text(const std::string& tag, const std::string& markdown, int64_t step, double wall_time) {
  const Message tensor = tensor_of(kDtString, 1).text(8, markdown);
  file_.append(record_of(plugin_event(wall_time, step, tag, "text", Message(), tensor)));
}

void TensorBoardEvents::scalars(int64_t step, double wall_time, const MetricsRow& row) {
  GIGA_CHECK(step >= 0, "step ", step, " for TensorBoard");
  append(step, wall_time, row, tensorboard_tag);
}

void TensorBoardEvents::comparison(int64_t update, double wall_time, const MetricsRow& row) {
  GIGA_CHECK(update >= 0 && update <= std::numeric_limits<int32_t>::max(), "update ", update, " for TensorBoard");
  append(update, wall_time, row, comparison_tag);
}

void TensorBoardEvents::append(int64_t step, double wall_time, const MetricsRow& row,
                               std::string (*tag)(std::string_view)) {
  Message summary;
  for (const auto& [name, value] : row)
    if (!std::isnan(value)) summary.message(1, Message().text(1, tag(name)).float32(2, static_cast<float>(value)));
  if (!summary.encoded().empty()) file_.append(record_of(event_at(wall_time, step).message(5, summary)));
}

std::string comparison_tag(std::string_view name) { return cat("hparams/", name); }

std::string tensorboard_tag(std::string_view name) {
  const std::string_view figure = name.substr(0, name.find("_vs_"));  // all of it where there is no opponent
  if (figure.size() > 2 && (figure.ends_with("_0") || figure.ends_with("_1"))) {
    const size_t end = figure.size() - 2;
    return cat(name.substr(0, end), "/team", name.substr(end));
  }
  return cat("run/", name);
}

}  // namespace giga
