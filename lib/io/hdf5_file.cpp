// The calls of the HDF5 C API, with errors as exceptions.
#include "io/hdf5_file.hpp"

#include <zlib.h>

#include <algorithm>

#include "core/error.hpp"

namespace giga::hdf5 {
namespace {

constexpr const char* kChecksum = "crc32";

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

template <class T>
void write_number(hid_t object, const char* name, hid_t type, hid_t memory_type, T value) {
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose, "create a data space");
  const Handle attribute(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
                         cat("create attribute '", name, "'"));
  check(H5Awrite(attribute, memory_type, &value), cat("write attribute '", name, "'"));
}

}  // namespace

uint64_t checksum(const NamedArray& a) { return ::crc32_z(0, a.bytes.data(), a.bytes.size()); }

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
  // The format that every version of HDF5 reads, and hdf5_reader.hpp.
  check(H5Pset_libver_bounds(access, H5F_LIBVER_EARLIEST, H5F_LIBVER_LATEST), "choose a format");
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
void write_attribute(hid_t object, const char* name, double value) {
  write_number(object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, value);
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

}  // namespace giga::hdf5
