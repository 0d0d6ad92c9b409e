// Files that only grow.
#include "io/append_file.hpp"

#include <fcntl.h>

#include <cerrno>
#include <cstring>

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
    throw InputError(cat("cannot go on with ", path.string(), ": it has ", file.size(), " bytes, the checkpoint says ",
                         size, ": it was changed or cut"));
  return file;
}

}  // namespace

AppendFile AppendFile::resume(const std::filesystem::path& path, uint64_t size) {
  File file = open_of_size(path, size);
  file.resize(size);
  return {std::move(file), size};
}

void AppendFile::expect(const std::filesystem::path& path, uint64_t size) { open_of_size(path, size); }

void AppendFile::append(std::string_view bytes) {
  file_.write_all(bytes);
  size_ += bytes.size();
}

}  // namespace giga
