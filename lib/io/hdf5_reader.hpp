// Hdf5Reader: reads the part of the HDF5 file format that checkpoints use, without the HDF5 library, which overruns
// buffers and leaks on malicious files. Every address and length is checked against the file.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "core/named_array.hpp"

namespace giga::hdf5 {

/// What a file of the library's default ("earliest") format holds: a superblock of version 0, groups as symbol tables,
/// object headers of version 1, contiguous datasets without filters, small attributes (HDF5 File Format Specification
/// 2.0, sections II.A, III.A, III.D, IV.A). Anything else is refused. All functions throw FormatError. The
/// bytes must outlive the reader.
class Reader {
 public:
  /// `user_block`: bytes before the superblock.
  Reader(std::string_view bytes, size_t user_block);

  /// Attributes of the root.
  std::string text_attribute(const std::string& name) const;
  int64_t int_attribute(const std::string& name) const;
  uint64_t uint_attribute(const std::string& name) const;
  double float_attribute(const std::string& name) const;

  /// A dataset with its checksum verified. One that claims more than `most_bytes` is refused before anything is
  /// allocated.
  NamedArray dataset(const std::string& path, size_t most_bytes) const;

 private:
  /// A message of an object header: what is known about the object, piece by piece.
  struct Message {
    unsigned type = 0, flags = 0;
    std::string_view data;
  };
  struct Attribute {
    std::string_view type, data;
  };

  std::string_view at(uint64_t address, uint64_t size) const;
  void read_group(uint64_t header, const std::string& path, int depth);
  void read_tree(uint64_t address, std::string_view names, const std::string& path, int depth);
  void read_entries(uint64_t address, std::string_view names, const std::string& path, int depth);
  std::vector<Message> messages(uint64_t header) const;
  Attribute attribute(const std::vector<Message>& object, const std::string& name) const;
  uint64_t number(const std::vector<Message>& object, const std::string& name, const std::string& type) const;

  std::string_view file_;  // from the superblock on: addresses count from there
  std::map<std::string, uint64_t> headers_;
  std::set<uint64_t> seen_;  // addresses of nodes and objects: none belongs to two
  mutable size_t n_messages_read_ = 0;
};

}  // namespace giga::hdf5
