// Writing and reading safetensors.
#include "export/safetensors.hpp"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "io/json.hpp"
#include "io/protobuf_wire.hpp"

namespace giga {
namespace {

constexpr const char* kMetadata = "__metadata__";
constexpr size_t kLengthBytes = 8, kAlignment = 8;
constexpr size_t kMostHeaderBytes = size_t{1} << 20;  // those of policies have some kilobytes
constexpr size_t kMostDimensions = 8;

/// Names of the format, in the order of ArrayType.
enum class Dtype : uint8_t { f32, f64, i32, i64, u8 };
constexpr std::array<const char*, 5> enum_names(Dtype) { return {"F32", "F64", "I32", "I64", "U8"}; }

struct Place {
  size_t begin = 0, end = 0;  // among the bytes behind the header
};

struct Entry {
  NamedArray tensor;
  Place place;
};

uint64_t read_length(std::string_view bytes) {
  uint64_t value = 0;
  for (size_t k = 0; k < kLengthBytes; ++k) value |= uint64_t{static_cast<unsigned char>(bytes[k])} << (8 * k);
  return value;
}

/// Reads one member of a tensor's entry.
template <class T>
bool read_member(const Node& entry, const char* key, const std::string& path, const Allowed& allowed, T& value,
                 Errors& errors) {
  const Node* node = entry.find(key);
  if (!node) return errors.add(entry.at, cat(path, ": ", key, " is missing")), false;
  return FieldCodec<T>::read(*node, value, allowed, {path + "." + key, errors});
}

/// Bytes of an array of that shape; false where no size_t holds them.
bool bytes_of(const std::vector<int64_t>& shape, size_t item, size_t& bytes) {
  bytes = item;
  for (const int64_t side : shape)
    if (__builtin_mul_overflow(bytes, static_cast<size_t>(side), &bytes)) return false;
  return true;
}

/// One tensor of the header, or false with the reason in `errors`. `available`: bytes behind the header.
bool read_entry(const Node::Entry& header, size_t available, Entry& entry, Errors& errors) {
  const std::string path = cat("tensor '", header.key, "'");
  const Node& node = header.value;
  if (!node.is_map()) return errors.add(node.at, cat(path, ": a map is needed here")), false;
  for (const Node::Entry& member : node.entries)
    if (member.key != "dtype" && member.key != "shape" && member.key != "data_offsets")
      errors.add(member.at, cat(path, ": '", member.key, "' is unknown; allowed: dtype, shape, data_offsets"));
  Dtype type{};
  std::vector<int64_t> shape;
  std::array<int64_t, 2> offsets{};
  const bool good = read_member(node, "dtype", path, {}, type, errors) &&
                    read_member(node, "shape", path, at_least(0).items(0, kMostDimensions), shape, errors) &&
                    read_member(node, "data_offsets", path, at_least(0), offsets, errors);
  if (!good) return false;
  const auto begin = static_cast<size_t>(offsets[0]), end = static_cast<size_t>(offsets[1]);
  if (begin > end || end > available)
    return errors.add(node.at, cat(path, ": data_offsets [", begin, ", ", end, "] lie outside of the ", available,
                                   " bytes behind the header")),
           false;
  const auto array_type = static_cast<ArrayType>(type);
  size_t bytes = 0;
  if (!bytes_of(shape, size_of(array_type), bytes) || bytes != end - begin)
    return errors.add(node.at, cat(path, ": its shape does not fit the ", end - begin, " bytes of its data_offsets")),
           false;
  entry = {{header.key, array_type, std::move(shape), {}}, {begin, end}};
  return true;
}

void check_metadata(const Node& node, Errors& errors) {
  if (!node.is_map()) return errors.add(node.at, cat(kMetadata, ": a map is needed here"));
  for (const Node::Entry& entry : node.entries)
    if (!entry.value.is_scalar() || !entry.value.quoted)
      errors.add(entry.value.at, cat(kMetadata, ": '", entry.key, "' is no text"));
}

/// The tensors of the header by their place; every byte behind it belongs to exactly one.
std::vector<Entry> read_header(std::string_view header, size_t available, const std::string& name) {
  Errors errors;
  const Document document = parse_yaml_text(header, name + " (header)", errors);  // JSON is YAML
  errors.throw_if_any();
  if (!document.root.is_map()) throw InputError(cat(name, ": the header is no JSON object"));
  std::vector<Entry> entries;
  for (const Node::Entry& member : document.root.entries) {
    Entry entry;
    if (member.key == kMetadata) {
      check_metadata(member.value, errors);
    } else if (read_entry(member, available, entry, errors)) {
      entries.push_back(std::move(entry));
    }
  }
  errors.throw_if_any();
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::pair(a.place.begin, a.place.end) < std::pair(b.place.begin, b.place.end);
  });
  size_t at = 0;
  for (const Entry& e : entries) {
    if (e.place.begin != at)
      throw InputError(cat(name, ": tensor '", e.tensor.name, "' begins at byte ", e.place.begin,
                           e.place.begin < at ? " inside another one; " : " behind bytes that belong to none; ",
                           "expected ", at));
    at = e.place.end;
  }
  if (at != available) throw InputError(cat(name, ": ", available - at, " bytes at the end belong to no tensor"));
  return entries;
}

}  // namespace

std::string encode_safetensors(const NamedArrays& tensors,
                               const std::vector<std::pair<std::string, std::string>>& metadata) {
  std::vector<const NamedArray*> order;  // the widest numbers first, so that each begins at a multiple of its size
  for (const NamedArray& tensor : tensors) order.push_back(&tensor);
  std::stable_sort(order.begin(), order.end(),
                   [](const NamedArray* a, const NamedArray* b) { return size_of(a->type) > size_of(b->type); });
  Json header = Json::object();
  for (const auto& [key, value] : metadata) header[kMetadata][key] = value;
  std::string data;
  for (const NamedArray* tensor : order) {
    const size_t begin = data.size();
    data.append(reinterpret_cast<const char*>(tensor->bytes.data()), tensor->bytes.size());
    header[tensor->name] = {{"dtype", FieldCodec<Dtype>::print(static_cast<Dtype>(tensor->type))},
                            {"shape", tensor->shape},
                            {"data_offsets", {begin, data.size()}}};
  }
  std::string text = json_text(header);
  text.resize((text.size() + kAlignment - 1) / kAlignment * kAlignment, ' ');
  GIGA_CHECK(text.size() <= kMostHeaderBytes, "a header of ", text.size(), " bytes");
  return little_endian(uint64_t{text.size()}) + text + data;
}

NamedArrays decode_safetensors(std::string_view bytes, const std::string& name) {
  if (bytes.size() < kLengthBytes)
    throw InputError(
        cat(name, " is no safetensors file: it has ", bytes.size(), " bytes, and a header takes at least 8"));
  const uint64_t length = read_length(bytes);
  const std::string_view behind = bytes.substr(kLengthBytes);
  if (length > behind.size() || length > kMostHeaderBytes)
    throw InputError(cat(name, " is no safetensors file, or damaged: its header would have ", length,
                         " bytes; allowed here: ", std::min(behind.size(), kMostHeaderBytes)));
  const std::string_view header = behind.substr(0, length), data = behind.substr(length);
  if (header.empty() || header[0] != '{')
    throw InputError(cat(name, " is no safetensors file: its header does not begin with {"));
  NamedArrays tensors;
  for (Entry& e : read_header(header, data.size(), name)) {
    const std::string_view part = data.substr(e.place.begin, e.place.end - e.place.begin);
    e.tensor.bytes.assign(part.begin(), part.end());
    tensors.push_back(std::move(e.tensor));
  }
  return tensors;
}

}  // namespace giga
