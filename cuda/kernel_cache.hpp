// KernelCache: compiled kernels in a folder of one user's, so that they are not compiled at each start.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

namespace giga {

/// A file for each key. Several processes may use the folder at once: a file is there whole, or not at all.
class KernelCache {
 public:
  /// An empty path: nothing is kept.
  explicit KernelCache(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// $GIGASTEP_CACHE_DIR, else gigastep in $XDG_CACHE_HOME, else in ~/.cache; empty where none of them is set.
  /// `environment(name)`: a variable; null where it is not set.
  static std::filesystem::path default_folder(const std::function<const char*(const char*)>& environment);

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path file_of(const std::string& key) const;
  /// The code that was kept under a key; none where there is none, or its file is damaged.
  std::optional<std::string> read(const std::string& key) const;
  /// Keeps code under a key; whether that could be done.
  bool write(const std::string& key, const std::string& code) const;

 private:
  std::filesystem::path folder_;
};

/// A number that tells texts apart (Fnv1a), as 16 digits.
std::string text_digest(const std::string& text);

}  // namespace giga
