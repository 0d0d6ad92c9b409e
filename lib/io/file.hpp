// File: an open file of the operating system. The seam of everything that must survive a crash: write_file, AppendFile
// and RunLock do all that they do to a disk through it. Only for lib/io/*.cpp.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace giga {

class File {
 public:
  /// `flags` as of open(2). Does not throw: see is_open. `told_as`: the path in errors; empty: `path`.
  File(const std::filesystem::path& path, int flags, const std::filesystem::path& told_as = {});
  ~File();
  File(File&& other) noexcept;
  File& operator=(File&&) = delete;

  bool is_open() const { return fd_ >= 0; }
  int descriptor() const { return fd_; }
  /// As errors tell it.
  const std::filesystem::path& path() const { return path_; }

  /// As read(2).
  int64_t read(char* to, size_t size) const;
  // All below throw Error with the file and the system's reason.
  uint64_t size() const;
  void write_all(std::string_view bytes) const;
  /// Cuts or extends to `size` bytes; what is written next stands behind them.
  void resize(uint64_t size) const;
  void flush_to_disk() const;
  /// Closes the file; some errors show only then.
  void close();

 private:
  std::filesystem::path path_;
  int fd_;
};

/// Throws Error "cannot WHAT PATH: reason", the reason being that of errno.
[[noreturn]] void fail_with_errno(const char* what, const std::filesystem::path& path);

}  // namespace giga
