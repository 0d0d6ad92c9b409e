#include "apps/own_program.hpp"

#include <filesystem>
#include <system_error>

namespace giga {

std::string own_program() {
  constexpr const char* kLink = "/proc/self/exe";
  std::error_code code;
  const std::filesystem::path path = std::filesystem::read_symlink(kLink, code);
  return !code && std::filesystem::equivalent(path, kLink, code) && !code ? path.string() : kLink;
}

}  // namespace giga
