// RunLock: keeps a second process out of a run folder.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace giga {

class File;

/// Its name in the folder.
constexpr const char* kLockFile = "lock";

/// Holds the file `lock` of a folder while it lives. The system releases it however
/// the process ends. A file that nobody holds is stale: its process was killed.
class RunLock {
 public:
  /// Throws InputError with the process that holds it, or where the folder cannot be written.
  explicit RunLock(const std::filesystem::path& folder);
  ~RunLock();
  RunLock(RunLock&&) noexcept;
  RunLock& operator=(RunLock&&) = delete;

  /// Who left the lock without taking it back ("process 4711 on host, since ..."); nothing where nobody did.
  const std::optional<std::string>& stale_owner() const { return stale_owner_; }

 private:
  std::unique_ptr<File> file_;
  std::optional<std::string> stale_owner_;
};

/// Who holds the lock of a folder now; nothing where nobody does.
std::optional<std::string> lock_owner(const std::filesystem::path& folder);

}  // namespace giga
