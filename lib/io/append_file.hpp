// AppendFile: a file that only grows, and whose length is known, so that a resumed run can cut off what an earlier
// process wrote after its last checkpoint.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "io/file.hpp"

namespace giga {

class AppendFile {
 public:
  /// A new file; throws Error where it exists or cannot be created.
  static AppendFile create(const std::filesystem::path& path);
  /// Goes on behind the first `size` bytes of a file; what stands there is cut off. Throws InputError where there is no
  /// such file or it is shorter.
  static AppendFile resume(const std::filesystem::path& path, uint64_t size);
  /// Throws what resume would, and changes nothing. A file that is missing is no fault here: it can be begun anew.
  static void expect(const std::filesystem::path& path, uint64_t size);
  /// Throws InputError: a file is not what was written, and what to do about it.
  [[noreturn]] static void fail_changed(const std::filesystem::path& path, const std::string& what);

  /// The bytes are the system's when this returns: a killed process has not lost them. Throws Error (a full disk).
  void append(std::string_view bytes);
  /// Waits until they are on the disk: a power failure has not lost them either.
  void flush_to_disk() const { file_.flush_to_disk(); }
  uint64_t size() const { return size_; }
  const std::filesystem::path& path() const { return file_.path(); }

 private:
  AppendFile(File&& file, uint64_t size) : file_(std::move(file)), size_(size) {}

  File file_;
  uint64_t size_;
};

}  // namespace giga
