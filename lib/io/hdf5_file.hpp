// Writing with the HDF5 library what checkpoints use: files in memory, attributes, uncompressed datasets;
// hdf5_reader.hpp reads it. Only for lib/io/*.cpp.
#pragma once

#include <hdf5.h>

#include <cstdint>
#include <stdexcept>
#include <string>

#include "core/named_array.hpp"

namespace giga::hdf5 {

/// What is wrong with a file, without its name.
class FormatError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An HDF5 identifier, closed at the end of its scope.
class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  /// Throws FormatError(cat("cannot ", what)) where the id is an error.
  Handle(hid_t id, Close close, const std::string& what);
  ~Handle() {
    if (id_ >= 0) close_(id_);
  }
  Handle(Handle&& other) noexcept : id_(other.id_), close_(other.close_) { other.id_ = -1; }
  Handle& operator=(Handle&&) = delete;
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  Close close_;
};

/// Keeps HDF5 from printing its error stack while it lives: errors are told by exceptions.
class QuietErrors {
 public:
  QuietErrors();
  ~QuietErrors();
  QuietErrors(const QuietErrors&) = delete;
  QuietErrors& operator=(const QuietErrors&) = delete;

 private:
  H5E_auto2_t function_ = nullptr;
  void* data_ = nullptr;
};

/// A new file in memory. Its first `user_block` bytes (a power of 2, at least 512) are not HDF5's.
Handle create_file(size_t user_block);
/// The bytes that such a file would have on disk, the first `user_block` of them zeros.
std::string file_bytes(hid_t file, size_t user_block);

void write_attribute(hid_t object, const char* name, const std::string& value);
void write_attribute(hid_t object, const char* name, int64_t value);
void write_attribute(hid_t object, const char* name, uint64_t value);
void write_attribute(hid_t object, const char* name, double value);

/// A dataset with its checksum as attribute `crc32`. Groups on the path are made.
void write_dataset(hid_t file, const std::string& path, const NamedArray& array);
uint64_t checksum(const NamedArray& array);

}  // namespace giga::hdf5
