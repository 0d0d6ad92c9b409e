// Reading HDF5 through its C interface.
#include "golden/hdf5_file.hpp"

#include "core/error.hpp"

namespace giga::golden {
namespace {

using Closer = herr_t (*)(hid_t);

std::shared_ptr<const hid_t> own(hid_t id, Closer close, const std::string& what) {
  GIGA_CHECK(id >= 0, what);
  return {new hid_t(id), [close](const hid_t* p) {
            close(*p);
            delete p;
          }};
}

}  // namespace

H5Group H5Group::open(const std::string& path) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // failures become our own errors
  H5Group file;
  file.where_ = path + ":";
  file.id_ = own(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose, "cannot open " + path + " as HDF5");
  return file;
}

bool H5Group::has(const std::string& name) const {
  for (size_t at = name.find('/'); at != std::string::npos; at = name.find('/', at + 1))
    if (H5Lexists(*id_, name.substr(0, at).c_str(), H5P_DEFAULT) <= 0) return false;
  return H5Lexists(*id_, name.c_str(), H5P_DEFAULT) > 0;
}

bool H5Group::has_attribute(const std::string& name) const { return H5Aexists(*id_, name.c_str()) > 0; }

std::vector<std::string> H5Group::children() const {
  std::vector<std::string> names;
  const auto visit = [](hid_t, const char* name, const H5L_info_t*, void* out) -> herr_t {
    static_cast<std::vector<std::string>*>(out)->emplace_back(name);
    return 0;
  };
  GIGA_CHECK(H5Literate(*id_, H5_INDEX_NAME, H5_ITER_INC, nullptr, visit, &names) >= 0, where_);
  return names;
}

H5Group H5Group::group(const std::string& name) const {
  H5Group child;
  child.where_ = where_ + name + "/";
  child.id_ = own(H5Gopen2(*id_, name.c_str(), H5P_DEFAULT), H5Gclose, "no group " + child.where_);
  return child;
}

template <class T>
Array<T> H5Group::read(const std::string& name, hid_t type) const {
  const auto set = own(H5Dopen2(*id_, name.c_str(), H5P_DEFAULT), H5Dclose, "no dataset " + where_ + name);
  const auto space = own(H5Dget_space(*set), H5Sclose, where_ + name);
  std::vector<hsize_t> extents(static_cast<size_t>(H5Sget_simple_extent_ndims(*space)));
  H5Sget_simple_extent_dims(*space, extents.data(), nullptr);
  Array<T> array;
  size_t size = 1;
  for (const hsize_t extent : extents) {
    array.shape.push_back(static_cast<size_t>(extent));
    size *= static_cast<size_t>(extent);
  }
  array.data.resize(size);
  if (size > 0)
    GIGA_CHECK(H5Dread(*set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, array.data.data()) >= 0, "reading ", where_, name);
  return array;
}

Array<float> H5Group::floats(const std::string& name) const { return read<float>(name, H5T_NATIVE_FLOAT); }
Array<double> H5Group::doubles(const std::string& name) const { return read<double>(name, H5T_NATIVE_DOUBLE); }
Array<int32_t> H5Group::ints(const std::string& name) const { return read<int32_t>(name, H5T_NATIVE_INT32); }

std::string H5Group::text(const std::string& name) const {
  const Array<uint8_t> bytes = read<uint8_t>(name, H5T_NATIVE_UINT8);
  return {bytes.data.begin(), bytes.data.end()};
}

std::string H5Group::text_attribute(const std::string& name) const {
  const auto attribute = own(H5Aopen(*id_, name.c_str(), H5P_DEFAULT), H5Aclose, "no attribute " + where_ + "@" + name);
  const auto type = own(H5Aget_type(*attribute), H5Tclose, where_ + name);
  GIGA_CHECK(H5Tget_class(*type) == H5T_STRING, where_, "@", name, " is no text");
  if (H5Tis_variable_str(*type) > 0) {
    char* read_text = nullptr;
    GIGA_CHECK(H5Aread(*attribute, *type, &read_text) >= 0, where_, name);
    const std::string text = read_text ? read_text : "";
    H5free_memory(read_text);
    return text;
  }
  std::string text(H5Tget_size(*type), '\0');
  GIGA_CHECK(H5Aread(*attribute, *type, text.data()) >= 0, where_, name);
  return text.substr(0, text.find('\0'));
}

double H5Group::number_attribute(const std::string& name) const {
  const auto attribute = own(H5Aopen(*id_, name.c_str(), H5P_DEFAULT), H5Aclose, "no attribute " + where_ + "@" + name);
  double value = 0;
  GIGA_CHECK(H5Aread(*attribute, H5T_NATIVE_DOUBLE, &value) >= 0, where_, name);
  return value;
}

}  // namespace giga::golden
