// Reading and writing whole files.
#include "io/files.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <system_error>

#include "core/error.hpp"
#include "io/file.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char* kTemporaryEnding = ".tmp";

void write_in_place(const fs::path& path, std::string_view bytes) {
  File file(path, O_WRONLY | O_APPEND);
  if (!file.is_open()) fail_with_errno("write", path);
  file.write_all(bytes);
  file.close();
}

void write_temporary(const fs::path& path, std::string_view bytes, const fs::path& in_place_of) {
  File file(path, O_WRONLY | O_CREAT | O_TRUNC, in_place_of);  // errors name what the user knows
  if (!file.is_open()) fail_with_errno("create", in_place_of);
  file.write_all(bytes);
  file.flush_to_disk();
  file.close();
}

}  // namespace

std::string read_file(const fs::path& path) {
  std::error_code code;
  if (!fs::exists(path, code)) throw InputError(cat("there is no file ", path.string()));
  if (fs::is_directory(path, code)) throw InputError(cat(path.string(), " is a folder, not a file"));
  const File file(path, O_RDONLY);
  if (!file.is_open()) throw InputError(cat("cannot read ", path.string(), ": ", std::strerror(errno)));

  std::string bytes;
  const uintmax_t expected = fs::file_size(path, code);
  if (!code) bytes.reserve(expected);
  char block[1 << 16];
  for (;;) {
    const int64_t count = file.read(block, sizeof block);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw InputError(cat("cannot read ", path.string(), ": ", std::strerror(errno)));
    if (count == 0) return bytes;
    bytes.append(block, static_cast<size_t>(count));
  }
}

bool is_written_in_place(const fs::path& path) {
  const std::string& text = path.native();
  const bool is_stream = text == "/dev/stdout" || text == "/dev/stderr" || text.starts_with("/dev/fd/") ||
                         text.starts_with("/proc/");  // links, often to files
  std::error_code code;
  return fs::exists(path, code) && (is_stream || !fs::is_regular_file(path, code));
}

void write_file(const fs::path& path, std::string_view bytes) {
  std::error_code code;
  if (is_written_in_place(path)) return write_in_place(path, bytes);
  if (fs::is_symlink(path, code) && fs::exists(path, code)) return write_file(fs::canonical(path), bytes);

  const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  const fs::path temporary = path.string() + "." + std::to_string(::getpid()) + kTemporaryEnding;
  try {
    write_temporary(temporary, bytes, path);
    if (::rename(temporary.c_str(), path.c_str()) != 0) fail_with_errno("write", path);
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
  // The rename itself must reach the disk, or a power failure could undo it.
  const File directory(folder, O_RDONLY | O_DIRECTORY);
  if (directory.is_open()) directory.flush_to_disk();
}

void make_folder_of(const fs::path& file) {
  if (!file.has_parent_path()) return;
  std::error_code code;
  fs::create_directories(file.parent_path(), code);
  if (code) throw InputError(cat("cannot create the folder ", file.parent_path().string(), ": ", code.message()));
}

void write_or_print(const std::string& destination, std::string_view text) {
  if (destination != "-") {
    make_folder_of(destination);
    return write_file(destination, text);
  }
  std::cout << text << std::flush;
  if (!std::cout) throw Error("cannot write to the standard output");
}

fs::path absolute_path(const fs::path& path) {
  fs::path whole = fs::absolute(path).lexically_normal();
  return whole.has_filename() ? whole : whole.parent_path();
}

std::string name_of_folder(const fs::path& folder) { return absolute_path(folder).filename().string(); }

bool is_unfinished(const fs::path& file) {
  const std::string process = file.stem().extension().string();
  return file.extension() == kTemporaryEnding && process.size() > 1 &&
         process.find_first_not_of("0123456789", 1) == std::string::npos;
}

int remove_temporaries(const fs::path& folder) {
  // Of a process that lives, unless the file is old: then the number is another one's, or of another machine.
  const auto is_being_written = [](const fs::path& file) {
    constexpr std::chrono::hours kLongest{1};
    std::error_code code;
    const fs::file_time_type written = fs::last_write_time(file, code);
    if (code || fs::file_time_type::clock::now() - written > kLongest) return false;
    const int process = std::atoi(file.stem().extension().c_str() + 1);
    return process > 0 && process != ::getpid() && (::kill(process, 0) == 0 || errno == EPERM);
  };
  int removed = 0;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (is_unfinished(entry.path()) && !is_being_written(entry.path()) && fs::remove(entry.path(), code)) ++removed;
  return removed;
}

}  // namespace giga
