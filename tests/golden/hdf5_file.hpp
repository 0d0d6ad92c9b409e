// Reading HDF5: groups, attributes and whole datasets as vectors.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace giga::golden {

/// A dataset in memory, row-major. `row(t)` is where the part of the first index t begins.
template <class T>
struct Array {
  std::vector<size_t> shape;
  std::vector<T> data;

  size_t rows() const { return shape.empty() ? 0 : shape[0]; }
  size_t row_size() const { return rows() == 0 ? 0 : data.size() / rows(); }
  const T* row(size_t t) const { return data.data() + t * row_size(); }
  bool empty() const { return data.empty(); }
};

/// A file (its root group) or a group inside one. Missing things throw Error with the file and the name.
class H5Group {
 public:
  static H5Group open(const std::string& path);

  bool has(const std::string& name) const;
  bool has_attribute(const std::string& name) const;
  std::vector<std::string> children() const;
  H5Group group(const std::string& name) const;

  /// A dataset of any number type, converted.
  Array<float> floats(const std::string& name) const;
  Array<double> doubles(const std::string& name) const;
  Array<int32_t> ints(const std::string& name) const;
  /// As `floats`, but empty where there is no such dataset.
  Array<float> floats_if(const std::string& name) const { return has(name) ? floats(name) : Array<float>{}; }
  /// A dataset of bytes as text.
  std::string text(const std::string& name) const;

  std::string text_attribute(const std::string& name) const;
  double number_attribute(const std::string& name) const;

 private:
  template <class T>
  Array<T> read(const std::string& name, hid_t type) const;

  std::shared_ptr<const hid_t> id_;
  std::string where_;
};

}  // namespace giga::golden
