// The lock of a run folder, by flock(2).
#include "io/run_lock.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cerrno>

#include "core/error.hpp"
#include "io/file.hpp"
#include "io/host_info.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::string this_process() {
  utsname name{};
  ::uname(&name);
  return cat("process ", ::getpid(), " on ", name.nodename, ", since ", utc_now());
}

/// The first line of a lock; empty where its owner took it back or has not written yet.
std::string owner_in(const File& file) {
  char text[256];
  const ssize_t count = ::pread(file.descriptor(), text, sizeof text, 0);
  const std::string line(text, count > 0 ? static_cast<size_t>(count) : 0);
  return line.substr(0, line.find('\n'));
}

bool try_to_lock(const File& file, int kind = LOCK_EX) {
  while (::flock(file.descriptor(), kind | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) return false;
    if (errno != EINTR) fail_with_errno("lock", file.path());
  }
  return true;
}

/// Whether the path still leads to the open file: another process may have removed it in between.
bool is_same_file(const File& file) {
  struct stat open_one {};
  struct stat named {};
  return ::fstat(file.descriptor(), &open_one) == 0 && ::stat(file.path().c_str(), &named) == 0 &&
         open_one.st_ino == named.st_ino && open_one.st_dev == named.st_dev;
}

}  // namespace

RunLock::RunLock(const fs::path& folder) {
  do {
    file_ = std::make_unique<File>(folder / kLockFile, O_RDWR | O_CREAT);
    if (!file_->is_open()) fail_with_errno("write", folder / kLockFile);
    if (!try_to_lock(*file_))
      throw InputError(cat("the run folder ", folder.string(), " is in use by ", owner_in(*file_)));
  } while (!is_same_file(*file_));
  if (const std::string owner = owner_in(*file_); !owner.empty()) stale_owner_ = owner;
  file_->resize(0);
  file_->write_all(this_process() + "\n");
}

RunLock::RunLock(RunLock&&) noexcept = default;

// Removed while it is still held: whoever opened it meanwhile notices that it is gone (is_same_file).
RunLock::~RunLock() {
  if (file_) ::unlink(file_->path().c_str());
}

std::optional<std::string> lock_owner(const fs::path& folder) {
  // A shared lock asks as well, is granted on NFS to who may only read, and turns away no other who asks.
  const File file(folder / kLockFile, O_RDONLY);
  if (!file.is_open() || try_to_lock(file, LOCK_SH)) return std::nullopt;
  return owner_in(file);
}

}  // namespace giga
