// The HDF5 file format, read with every length checked.
#include "io/hdf5_reader.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>

#include "core/error.hpp"
#include "io/hdf5_file.hpp"

namespace giga::hdf5 {
namespace {

constexpr int kDeepest = 32;  // groups in groups, and levels of a tree
constexpr uint64_t kMaxRank = 8;

// Types of messages.
constexpr unsigned kDataspace = 0x01, kDatatype = 0x03, kExternalFiles = 0x07, kLayout = 0x08, kFilters = 0x0B,
                   kAttribute = 0x0C, kContinuation = 0x10, kSymbolTable = 0x11;
constexpr unsigned kSharedFlag = 2;

[[noreturn]] void broken() { throw FormatError("is damaged: its HDF5 structure is broken"); }

/// Takes little-endian numbers and parts from the front of bytes.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : left_(bytes) {}

  std::string_view take(uint64_t size) {
    if (size > left_.size()) broken();
    const std::string_view part = left_.substr(0, static_cast<size_t>(size));
    left_.remove_prefix(static_cast<size_t>(size));
    return part;
  }
  uint64_t number(size_t bytes) {
    uint64_t value = 0;
    const std::string_view part = take(bytes);
    for (size_t k = bytes; k-- > 0;) value = value << 8 | static_cast<unsigned char>(part[k]);
    return value;
  }
  void expect(std::string_view signature) {
    if (take(signature.size()) != signature) broken();
  }
  size_t left() const { return left_.size(); }

 private:
  std::string_view left_;
};

uint64_t padded(uint64_t size) { return (size + 7) / 8 * 8; }

/// How the types of arrays are written: class and version, flags, size, then what describes the bits.
std::string encoded_type(ArrayType type) {
  using namespace std::string_literals;
  switch (type) {
    case ArrayType::f32:  // sign at bit 31; 32 bits, exponent of 8 at 23, mantissa of 23 at 0, bias 127
      return "\x11\x20\x1F\x00\x04\x00\x00\x00\x00\x00\x20\x00\x17\x08\x00\x17\x7F\x00\x00\x00"s;
    case ArrayType::f64:
      return "\x11\x20\x3F\x00\x08\x00\x00\x00\x00\x00\x40\x00\x34\x0B\x00\x34\xFF\x03\x00\x00"s;
    case ArrayType::i32:
      return "\x10\x08\x00\x00\x04\x00\x00\x00\x00\x00\x20\x00"s;
    case ArrayType::i64:
      return "\x10\x08\x00\x00\x08\x00\x00\x00\x00\x00\x40\x00"s;
    case ArrayType::u8:
      return "\x10\x00\x00\x00\x01\x00\x00\x00\x00\x00\x08\x00"s;
  }
  broken();
}
/// That of unsigned integers of 8 bytes.
std::string unsigned_type() {
  using namespace std::string_literals;
  return "\x10\x00\x00\x00\x08\x00\x00\x00\x00\x00\x40\x00"s;
}

ArrayType array_type(std::string_view encoded, const std::string& path) {
  for (const ArrayType t : {ArrayType::f32, ArrayType::f64, ArrayType::i32, ArrayType::i64, ArrayType::u8})
    if (encoded.starts_with(encoded_type(t))) return t;
  throw FormatError("'" + path + "' has a type that no checkpoint has");
}

/// Extents of a dataspace; none of one number alone.
std::vector<uint64_t> extents(std::string_view dataspace, const std::string& what) {
  Cursor in(dataspace);
  const uint64_t version = in.number(1), rank = in.number(1);
  if (version < 1 || version > 2) broken();
  if (rank > kMaxRank) throw FormatError(cat(what, " has ", rank, " dimensions"));
  in.take(version == 1 ? 6 : 2);
  std::vector<uint64_t> extent(static_cast<size_t>(rank));
  for (uint64_t& n : extent) n = in.number(8);
  return extent;
}

}  // namespace

Reader::Reader(std::string_view bytes, size_t user_block) : file_(bytes.substr(std::min(user_block, bytes.size()))) {
  Cursor in(file_);
  in.expect("\x89HDF\r\n\x1a\n");
  in.expect(std::string_view("\0\0\0\0\0\x08\x08\0", 8));  // versions; addresses and lengths of 8 bytes
  in.take(8);
  if (in.number(8) != user_block) broken();
  in.take(24 + 8);
  read_group(in.number(8), "", 0);
}

std::string_view Reader::at(uint64_t address, uint64_t size) const {
  if (address > file_.size() || size > file_.size() - address) broken();
  return file_.substr(static_cast<size_t>(address), static_cast<size_t>(size));
}

void Reader::read_group(uint64_t header, const std::string& path, int depth) {
  if (depth > kDeepest || !headers_.emplace(path, header).second) broken();
  for (const Message& message : messages(header)) {
    if (message.type != kSymbolTable) continue;
    Cursor in(message.data);
    const uint64_t tree = in.number(8), heap_address = in.number(8);
    Cursor heap(at(heap_address, 32));
    heap.expect(std::string_view("HEAP\0\0\0\0", 8));
    const uint64_t size = heap.number(8);
    heap.take(8);
    read_tree(tree, at(heap.number(8), size), path, depth + 1);
  }
}

void Reader::read_tree(uint64_t address, std::string_view names, const std::string& path, int depth) {
  if (depth > kDeepest || !seen_.insert(address).second) broken();
  Cursor in(at(address, 24));
  in.expect(std::string_view("TREE\0", 5));
  const uint64_t level = in.number(1), n_children = in.number(2);
  Cursor children(at(address + 24, n_children * 16));
  for (uint64_t k = 0; k < n_children; ++k) {
    children.take(8);  // a key
    const uint64_t child = children.number(8);
    if (level > 0)
      read_tree(child, names, path, depth + 1);
    else
      read_entries(child, names, path, depth);
  }
}

void Reader::read_entries(uint64_t address, std::string_view names, const std::string& path, int depth) {
  constexpr uint64_t kEntryBytes = 40;
  if (!seen_.insert(address).second) broken();
  Cursor in(at(address, 8));
  in.expect(std::string_view("SNOD\1\0", 6));
  const uint64_t n_entries = in.number(2);
  Cursor entries(at(address + 8, n_entries * kEntryBytes));
  for (uint64_t k = 0; k < n_entries; ++k) {
    Cursor entry(entries.take(kEntryBytes));
    const uint64_t name_at = entry.number(8), header = entry.number(8), cache = entry.number(4);
    if (name_at >= names.size() || cache > 1) broken();  // 2 is a link to elsewhere
    const std::string_view rest = names.substr(static_cast<size_t>(name_at));
    const size_t length = rest.find('\0');
    if (length == 0 || length == std::string_view::npos || rest.substr(0, length).find('/') != std::string_view::npos)
      broken();
    // An object has one name: where two ways lead to it, endless ones could.
    if (!seen_.insert(header).second) broken();
    read_group(header, path + (path.empty() ? "" : "/") + std::string(rest.substr(0, length)), depth);
  }
}

std::vector<Reader::Message> Reader::messages(uint64_t header) const {
  Cursor start(at(header, 16));
  start.expect(std::string_view("\1\0", 2));
  const uint64_t n_messages = start.number(2);
  start.take(4);
  std::vector<std::string_view> blocks = {at(header + 16, start.number(4))};
  std::vector<Message> found;
  for (size_t b = 0; b < blocks.size(); ++b) {
    Cursor in(blocks[b]);
    while (in.left() >= 8 && found.size() < n_messages) {
      Message message;
      message.type = static_cast<unsigned>(in.number(2));
      const uint64_t size = in.number(2);
      message.flags = static_cast<unsigned>(in.number(1));
      in.take(3);
      message.data = in.take(size);
      found.push_back(message);
      // Each has at least 8 bytes and is read a few times. Only parts that overlap exceed this.
      if (++n_messages_read_ > file_.size()) broken();
      if (message.type != kContinuation) continue;
      Cursor place(message.data);
      const uint64_t address = place.number(8);
      blocks.push_back(at(address, place.number(8)));
    }
  }
  return found;
}

Reader::Attribute Reader::attribute(const std::vector<Message>& object, const std::string& name) const {
  for (const Message& message : object) {
    if (message.type != kAttribute) continue;
    Cursor in(message.data);
    const uint64_t version = in.number(1), flags = in.number(1);
    const uint64_t name_size = in.number(2), type_size = in.number(2), space_size = in.number(2);
    if (version < 1 || version > 3 || (version > 1 && flags != 0) || (message.flags & kSharedFlag)) broken();
    if (version == 3) in.take(1);
    const auto part = [&](uint64_t size) { return in.take(version == 1 ? padded(size) : size).substr(0, size); };
    const std::string_view found = part(name_size);
    if (found.substr(0, found.find('\0')) != name) continue;
    const std::string_view type = part(type_size), space = part(space_size);
    for (const uint64_t n : extents(space, "attribute '" + name + "'"))
      if (n != 1) throw FormatError(cat("attribute '", name, "' has another type than expected"));
    return {type, in.take(in.left())};
  }
  throw FormatError("cannot read attribute '" + name + "'");
}

/// The 8 bytes of an attribute of that (encoded) type.
uint64_t Reader::number(const std::vector<Message>& object, const std::string& name, const std::string& type) const {
  const Attribute found = attribute(object, name);
  if (!found.type.starts_with(type)) throw FormatError(cat("attribute '", name, "' has another type than expected"));
  return Cursor(found.data).number(8);
}

std::string Reader::text_attribute(const std::string& name) const {
  const Attribute found = attribute(messages(headers_.at("")), name);
  Cursor type(found.type);
  constexpr uint64_t kStringClass = 0x13;  // of version 1
  if (type.number(1) != kStringClass) throw FormatError(cat("attribute '", name, "' has another type than expected"));
  type.take(3);
  const std::string_view text = Cursor(found.data).take(type.number(4));
  return std::string(text.substr(0, text.find('\0')));
}

int64_t Reader::int_attribute(const std::string& name) const {
  return static_cast<int64_t>(number(messages(headers_.at("")), name, encoded_type(ArrayType::i64)));
}

uint64_t Reader::uint_attribute(const std::string& name) const {
  return number(messages(headers_.at("")), name, unsigned_type());
}

double Reader::float_attribute(const std::string& name) const {
  return std::bit_cast<double>(number(messages(headers_.at("")), name, encoded_type(ArrayType::f64)));
}

NamedArray Reader::dataset(const std::string& path, size_t most_bytes) const {
  const auto header = headers_.find(path);
  if (header == headers_.end()) throw FormatError("cannot read '" + path + "'");
  const std::vector<Message> object = messages(header->second);
  const auto message = [&](unsigned type) {
    for (const Message& m : object)
      if (m.type == type && !(m.flags & kSharedFlag)) return m.data;
    throw FormatError("cannot read '" + path + "'");
  };
  // What we write lies in the file as it is. Anything else could point to other files, or unpack to any size.
  Cursor layout(message(kLayout));
  const uint64_t version = layout.number(1), kind = layout.number(1);
  constexpr uint64_t kContiguous = 1;
  const bool elsewhere = std::any_of(object.begin(), object.end(),
                                     [](const Message& m) { return m.type == kExternalFiles || m.type == kFilters; });
  if (version < 3 || version > 4 || kind != kContiguous || elsewhere)
    throw FormatError("'" + path + "' is stored in a way that no checkpoint uses");

  NamedArray array;
  array.type = array_type(message(kDatatype), path);
  uint64_t bytes = size_of(array.type);
  for (const uint64_t n : extents(message(kDataspace), "'" + path + "'")) {
    if (n > most_bytes || (n != 0 && bytes > most_bytes / n))
      throw FormatError("'" + path + "' is larger than the file");
    bytes *= n;
    array.shape.push_back(static_cast<int64_t>(n));
  }
  if (bytes > most_bytes) throw FormatError("'" + path + "' is larger than the file");
  const uint64_t address = layout.number(8);
  if (bytes > 0) {
    const std::string_view data = at(address, bytes);
    array.bytes.assign(data.begin(), data.end());
  }
  if (number(object, "crc32", unsigned_type()) != checksum(array))
    throw FormatError("is damaged: the checksum of '" + path + "' does not match");
  return array;
}

}  // namespace giga::hdf5
