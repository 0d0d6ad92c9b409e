// Reading and writing compiled kernels.
#include "cuda/kernel_cache.hpp"

#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <system_error>

#include "core/error.hpp"
#include "core/fnv1a.hpp"

namespace giga {
namespace {

/// What a file holds: what it is and a digest of all that follows, the sizes, the key, the code.
std::string file_text(const std::string& key, const std::string& code) {
  const std::string body = cat(key.size(), " ", code.size(), "\n", key, code);
  return cat("gigastep kernel ", text_digest(body), "\n", body);
}

}  // namespace

std::string text_digest(const std::string& text) {
  Fnv1a hash;
  hash.add_all(text);
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(hash.value()));
  return digits;
}

std::filesystem::path KernelCache::default_folder(const std::function<const char*(const char*)>& environment) {
  constexpr std::pair<const char*, const char*> kPlaces[] = {
      {"GIGASTEP_CACHE_DIR", ""}, {"XDG_CACHE_HOME", "gigastep"}, {"HOME", ".cache/gigastep"}};
  for (const auto& [variable, below] : kPlaces)
    if (const char* value = environment(variable); value && *value) return std::filesystem::path(value) / below;
  return {};
}

std::filesystem::path KernelCache::file_of(const std::string& key) const {
  return folder_ / (text_digest(key) + ".kernel");
}

std::optional<std::string> KernelCache::read(const std::string& key) const {
  if (folder_.empty()) return std::nullopt;
  std::ifstream file(file_of(key), std::ios::binary);
  if (!file) return std::nullopt;
  // By read(), which notes an error; the iterators of a stream throw it.
  std::error_code error;
  const auto size = std::filesystem::file_size(file_of(key), error);
  if (error) return std::nullopt;
  std::string text(size, '\0');
  if (!file.read(text.data(), static_cast<std::streamsize>(size))) return std::nullopt;
  // The code is what stands behind the key; the file is that of this key and code if it would be written so.
  const size_t at = text.find(key);
  if (at == std::string::npos) return std::nullopt;
  std::string code = text.substr(at + key.size());
  if (code.empty() || file_text(key, code) != text) return std::nullopt;
  return code;
}

bool KernelCache::write(const std::string& key, const std::string& code) const {
  if (folder_.empty()) return false;
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  const std::filesystem::path file = file_of(key);
  std::string temporary = file.string() + ".XXXXXX";
  const int descriptor = ::mkstemp(temporary.data());
  if (descriptor < 0) return false;
  ::close(descriptor);
  std::ofstream out(temporary, std::ios::binary);
  out << file_text(key, code);
  out.close();
  if (out) std::filesystem::rename(temporary, file, error);
  if (!out || error) std::remove(temporary.c_str());
  return out && !error;
}

}  // namespace giga
