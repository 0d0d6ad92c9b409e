// The calls of the HDF5 C API, with errors as exceptions.
#include "io/hdf5_file.hpp"

#include <zlib.h>

#include <algorithm>

#include "core/error.hpp"

namespace giga::hdf5 {
namespace {

constexpr const char* kChecksum = "crc32";
constexpr int kMaxRank = 8;
constexpr size_t kMaxTextAttribute = 1 << 16;

void check(herr_t status, const std::string& what) {
  if (status < 0) throw FormatError("cannot " + what);
}

/// The type of an array in files, on every machine.
hid_t file_type(ArrayType type) {
  switch (type) {
    case ArrayType::f32:
      return H5T_IEEE_F32LE;
    case ArrayType::f64:
      return H5T_IEEE_F64LE;
    case ArrayType::i32:
      return H5T_STD_I32LE;
    case ArrayType::i64:
      return H5T_STD_I64LE;
    case ArrayType::u8:
      return H5T_STD_U8LE;
  }
  throw FormatError("unknown type of array");
}

ArrayType array_type(hid_t type, const std::string& path) {
  for (const ArrayType t : {ArrayType::f32, ArrayType::f64, ArrayType::i32, ArrayType::i64, ArrayType::u8})
    if (H5Tequal(type, file_type(t)) > 0) return t;
  throw FormatError("'" + path + "' has a type that no checkpoint has");
}

template <class T>
void write_number(hid_t object, const char* name, hid_t type, hid_t memory_type, T value) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "create a data space");
  const Handle attribute(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                         cat("create attribute '", name, "'"));
  check(H5Awrite(attribute, memory_type, &value), cat("write attribute '", name, "'"));
}

Handle open_attribute(hid_t object, const char* name, H5T_class_t wanted) {
  Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose, cat("read attribute '", name, "'"));
  const Handle type(H5Aget_type(attribute), H5Tclose, cat("read attribute '", name, "'"));
  const Handle space(H5Aget_space(attribute), H5Sclose, cat("read attribute '", name, "'"));
  if (H5Tget_class(type) != wanted || H5Sget_simple_extent_npoints(space) != 1)
    throw FormatError(cat("attribute '", name, "' has another type than expected"));
  return attribute;
}

template <class T>
T read_number(hid_t object, const char* name, hid_t memory_type) {
  const Handle attribute = open_attribute(object, name, H5T_INTEGER);
  T value{};
  check(H5Aread(attribute, memory_type, &value), cat("read attribute '", name, "'"));
  return value;
}

uint64_t checksum(const NamedArray& a) { return ::crc32_z(0, a.bytes.data(), a.bytes.size()); }

}  // namespace

Handle::Handle(hid_t id, Close close, const std::string& what) : id_(id), close_(close) {
  if (id < 0) throw FormatError("cannot " + what);
}

QuietErrors::QuietErrors() {
  H5Eget_auto2(H5E_DEFAULT, &function_, &data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}
QuietErrors::~QuietErrors() { H5Eset_auto2(H5E_DEFAULT, function_, data_); }

Handle create_file(size_t user_block) {
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose, "create a property list");
  check(H5Pset_userblock(creation, user_block), "keep room for a seal");
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "create a property list");
  check(H5Pset_fapl_core(access, 1 << 20, false), "keep a file in memory");
  // The name matters only while the file is open: HDF5 tells open files apart by it.
  return Handle(H5Fcreate("gigastep checkpoint (being written)", H5F_ACC_TRUNC, creation, access), H5Fclose,
                "create a file in memory");
}

std::string file_bytes(hid_t file, size_t user_block) {
  check(H5Fflush(file, H5F_SCOPE_GLOBAL), "flush the file");
  const ssize_t size = H5Fget_file_image(file, nullptr, 0);  // without the user block
  if (size < 0) throw FormatError("cannot take the file's bytes");
  std::string bytes(user_block + static_cast<size_t>(size), '\0');
  if (H5Fget_file_image(file, bytes.data() + user_block, static_cast<size_t>(size)) != size)
    throw FormatError("cannot take the file's bytes");
  return bytes;
}

Handle open_file(std::string_view bytes) {
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "create a property list");
  check(H5Pset_fapl_core(access, 1 << 20, false), "keep a file in memory");
  // HDF5 copies the bytes; the API merely lacks a const.
  check(H5Pset_file_image(access, const_cast<char*>(bytes.data()), bytes.size()), "keep a file in memory");
  const hid_t file = H5Fopen("gigastep checkpoint (being read)", H5F_ACC_RDONLY, access);
  if (file < 0) throw FormatError("is damaged: its HDF5 structure is broken");
  return Handle(file, H5Fclose, "open the file");
}

void write_attribute(hid_t object, const char* name, const std::string& value) {
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose, "create a type");
  check(H5Tset_size(type, std::max<size_t>(value.size(), 1)), "create a type");
  check(H5Tset_strpad(type, H5T_STR_NULLPAD), "create a type");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "create a type");
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "create a data space");
  const Handle attribute(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                         cat("create attribute '", name, "'"));
  check(H5Awrite(attribute, type, value.c_str()), cat("write attribute '", name, "'"));
}
void write_attribute(hid_t object, const char* name, int64_t value) {
  write_number(object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, value);
}
void write_attribute(hid_t object, const char* name, uint64_t value) {
  write_number(object, name, H5T_STD_U64LE, H5T_NATIVE_UINT64, value);
}

std::string read_text_attribute(hid_t object, const char* name) {
  const Handle attribute = open_attribute(object, name, H5T_STRING);
  const Handle type(H5Aget_type(attribute), H5Tclose, cat("read attribute '", name, "'"));
  const size_t size = H5Tget_size(type);
  if (H5Tis_variable_str(type) != 0 || size > kMaxTextAttribute)
    throw FormatError(cat("attribute '", name, "' has another type than expected"));
  std::string value(size, '\0');
  check(H5Aread(attribute, type, value.data()), cat("read attribute '", name, "'"));
  value.resize(std::min(value.find('\0'), value.size()));
  return value;
}
int64_t read_int_attribute(hid_t object, const char* name) {
  return read_number<int64_t>(object, name, H5T_NATIVE_INT64);
}
uint64_t read_uint_attribute(hid_t object, const char* name) {
  return read_number<uint64_t>(object, name, H5T_NATIVE_UINT64);
}

void write_dataset(hid_t file, const std::string& path, const NamedArray& array) {
  const std::string what = "write '" + path + "'";
  std::vector<hsize_t> extent(array.shape.begin(), array.shape.end());
  size_t count = 1;
  for (const hsize_t n : extent) count *= n;
  GIGA_CHECK(count * size_of(array.type) == array.bytes.size(), "array '", array.name, "' has ", array.bytes.size(),
             " bytes, its shape asks for ", count * size_of(array.type));

  const Handle links(H5Pcreate(H5P_LINK_CREATE), H5Pclose, what);
  check(H5Pset_create_intermediate_group(links, 1), what);
  const Handle space(extent.empty() ? H5Screate(H5S_SCALAR)
                                    : H5Screate_simple(static_cast<int>(extent.size()), extent.data(), nullptr),
                     H5Sclose, what);
  const hid_t type = file_type(array.type);
  const Handle dataset(H5Dcreate2(file, path.c_str(), type, space, links, H5P_DEFAULT, H5P_DEFAULT), H5Dclose, what);
  if (count > 0) check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, array.bytes.data()), what);
  write_attribute(dataset, kChecksum, checksum(array));
}

NamedArray read_dataset(hid_t file, const std::string& path, size_t most_bytes) {
  const std::string what = "read '" + path + "'";
  const Handle dataset(H5Dopen2(file, path.c_str(), H5P_DEFAULT), H5Dclose, what);
  const Handle type(H5Dget_type(dataset), H5Tclose, what);
  const Handle space(H5Dget_space(dataset), H5Sclose, what);
  const Handle properties(H5Dget_create_plist(dataset), H5Pclose, what);
  // What we write lies in the file as it is. Anything else could point to other files, or unpack to any size.
  if (H5Pget_layout(properties) != H5D_CONTIGUOUS || H5Pget_external_count(properties) != 0)
    throw FormatError("'" + path + "' is stored in a way that no checkpoint uses");

  NamedArray array;
  array.type = array_type(type, path);
  const int rank = H5Sget_simple_extent_ndims(space);
  if (rank < 0 || rank > kMaxRank) throw FormatError(cat("'", path, "' has ", rank, " dimensions"));
  std::vector<hsize_t> extent(static_cast<size_t>(rank));
  if (rank > 0) check(H5Sget_simple_extent_dims(space, extent.data(), nullptr), what);
  size_t bytes = size_of(array.type);
  for (const hsize_t n : extent) {
    if (n != 0 && bytes > most_bytes / n) throw FormatError("'" + path + "' is larger than the file");
    bytes *= n;
    array.shape.push_back(static_cast<int64_t>(n));
  }
  if (bytes > most_bytes) throw FormatError("'" + path + "' is larger than the file");
  array.bytes.resize(bytes);
  if (bytes > 0)
    check(H5Dread(dataset, file_type(array.type), H5S_ALL, H5S_ALL, H5P_DEFAULT, array.bytes.data()), what);
  if (read_uint_attribute(dataset, kChecksum) != checksum(array))
    throw FormatError("is damaged: the checksum of '" + path + "' does not match");
  return array;
}

}  // namespace giga::hdf5
