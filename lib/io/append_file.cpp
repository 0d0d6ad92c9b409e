// Files that only grow.
#include "io/append_file.hpp"

#include <fcntl.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "core/error.hpp"

namespace giga {

AppendFile AppendFile::create(const std::filesystem::path& path) {
  File file(path, O_WRONLY | O_CREAT | O_EXCL);
  if (!file.is_open()) fail_with_errno("create", path);
  return {std::move(file), 0};
}

namespace {

File open_of_size(const std::filesystem::path& path, uint64_t size) {
  File file(path, O_WRONLY);
  if (!file.is_open()) throw InputError(cat("cannot go on with ", path.string(), ": ", std::strerror(errno)));
  if (file.size() < size)
    AppendFile::fail_changed(path, cat("it has ", file.size(), " bytes, the checkpoint says ", size));
  return file;
}

}  // namespace

AppendFile AppendFile::resume(const std::filesystem::path& path, uint64_t size) {
  File file = open_of_size(path, size);
  file.resize(size);
  return {std::move(file), size};
}

void AppendFile::expect(const std::filesystem::path& path, uint64_t size) {
  std::error_code code;
  if (std::filesystem::exists(path, code)) open_of_size(path, size);
}

void AppendFile::fail_changed(const std::filesystem::path& path, const std::string& what) {
  throw InputError(cat("cannot go on with ", path.string(), ": ", what,
                       ": it was changed or cut; move it away, and it is begun anew"));
}

void AppendFile::append(std::string_view bytes) {
  file_.write_all(bytes);
  size_ += bytes.size();
}

}  // namespace giga
