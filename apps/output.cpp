#include "apps/output.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "core/error.hpp"
#include "io/files.hpp"
#include "io/run_lock.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

fs::path folder_of(const fs::path& file) { return file.has_parent_path() ? file.parent_path() : fs::path("."); }

/// Why nothing can be written there; empty where it can.
std::string obstacle(const fs::path& path, Output kind) {
  std::error_code code;
  if (path.empty()) return "a name is missing";
  if (path == "-") {
    if (kind == Output::file_or_stdout) return "";
    return "this is not written to the standard output; a file of that name is ./-";
  }
  if (kind == Output::file_or_stdout) kind = Output::file;
  if (kind != Output::folder && path.filename().empty()) return cat(path.string(), " names no file");
  if (kind == Output::file && fs::is_directory(path, code)) return cat(path.string(), " is a folder, not a file");
  if (kind == Output::folder && fs::exists(path, code) && !fs::is_directory(path, code))
    return cat(path.string(), " is a file, not a folder");
  if (kind == Output::file && is_written_in_place(path)) return "";
  // The nearest folder that is there: those below it will be made.
  fs::path folder = kind == Output::folder ? path : folder_of(path);
  while (!fs::exists(folder, code) && folder.has_relative_path() && folder != folder_of(folder))
    folder = folder_of(folder);
  if (!fs::is_directory(folder, code)) return cat(folder.string(), " is a file, not a folder");
  if (::access(folder.c_str(), W_OK | X_OK) != 0)
    return cat("nothing can be written in ", folder.string(), ": ", std::strerror(errno));
  return "";
}

}  // namespace

CLI::Validator output(Output kind) {
  return {[kind](std::string& text) { return obstacle(text, kind); }, ""};
}

void expect_output(Output kind, const fs::path& path, const std::string& advice) {
  if (const std::string what = obstacle(path, kind); !what.empty()) throw InputError(cat(what, "; ", advice));
}

bool holds_files(const fs::path& folder) {
  std::error_code code;
  const fs::directory_iterator files(folder, code);
  return !code &&
         std::any_of(begin(files), end(files), [](const auto& file) { return file.path().filename() != kLockFile; });
}

void write_output(const fs::path& file, std::string_view bytes) {
  make_folder_of(file);
  write_file(file, bytes);
}

}  // namespace giga
