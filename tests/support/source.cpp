// The only file of the tests that is compiled with the path of the checkout.
#include "support/source.hpp"

#include <cstdlib>
#include <map>

namespace giga::test {
namespace {

std::string find_python(const std::string& modules) {
  // By the environment, so that the shell takes a path with spaces as one word.
  ::setenv("GIGASTEP_TEST_IMPORT", ("import " + modules).c_str(), 1);
  for (const std::string& python : {source_path(".venv/bin/python"), std::string("python3")}) {
    ::setenv("GIGASTEP_TEST_PYTHON", python.c_str(), 1);
    if (std::system("\"$GIGASTEP_TEST_PYTHON\" -c \"$GIGASTEP_TEST_IMPORT\" >/dev/null 2>&1 </dev/null") == 0)
      return python;
  }
  return "";
}

}  // namespace

std::string source_path(const std::string& name) {
  const std::string root = GIGASTEP_SOURCE_DIR;
  return name.empty() ? root : root + "/" + name;
}

std::string python_with(const std::string& modules) {
  static std::map<std::string, std::string> found;  // starting Python takes a part of a second
  const auto [at, is_new] = found.try_emplace(modules);
  if (is_new) at->second = find_python(modules);
  return at->second;
}

}  // namespace giga::test
