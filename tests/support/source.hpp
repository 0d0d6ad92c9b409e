// Where the checkout is, and a Python for the tests that look at our files with other programs.
#pragma once

#include <string>

namespace giga::test {

/// A file or folder of the checkout by its path there; the checkout itself for "".
std::string source_path(const std::string& name = "");

/// A Python that can `import modules` ("jsonschema, yaml"): the one of .venv,
/// else python3 of PATH, by this name; empty where there is none. A shell needs it in quotes.
std::string python_with(const std::string& modules);

}  // namespace giga::test
