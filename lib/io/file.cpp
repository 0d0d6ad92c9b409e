// Open files, by the calls of POSIX.
#include "io/file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "core/error.hpp"

namespace giga {

void fail_with_errno(const char* what, const std::filesystem::path& path) {
  throw Error(cat("cannot ", what, " ", path.string(), ": ", std::strerror(errno)));
}

File::File(const std::filesystem::path& path, int flags, const std::filesystem::path& told_as)
    : path_(told_as.empty() ? path : told_as), fd_(::open(path.c_str(), flags | O_CLOEXEC, 0644)) {}

File::~File() {
  if (fd_ >= 0) ::close(fd_);
}

File::File(File&& other) noexcept : path_(std::move(other.path_)), fd_(std::exchange(other.fd_, -1)) {}

int64_t File::read(char* to, size_t size) const { return ::read(fd_, to, size); }

uint64_t File::size() const {
  struct stat facts {};
  if (::fstat(fd_, &facts) != 0) fail_with_errno("read", path_);
  return static_cast<uint64_t>(facts.st_size);
}

void File::write_all(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail_with_errno("write", path_);
    bytes.remove_prefix(static_cast<size_t>(written));
  }
}

void File::resize(uint64_t size) const {
  const auto length = static_cast<off_t>(size);
  if (::ftruncate(fd_, length) != 0 || ::lseek(fd_, length, SEEK_SET) < 0) fail_with_errno("write", path_);
}

void File::flush_to_disk() const {
  if (::fsync(fd_) != 0) fail_with_errno("write", path_);
}

void File::close() {
  const int result = ::close(std::exchange(fd_, -1));
  if (result != 0) fail_with_errno("write", path_);
}

}  // namespace giga
