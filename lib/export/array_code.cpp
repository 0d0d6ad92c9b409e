// Formulas over arrays in Python. PyTorch's maximum and minimum take no plain numbers: formulas use `where` for those.
#include "export/array_code.hpp"

#include <cctype>

#include "config/names.hpp"
#include "core/error.hpp"
#include "io/number.hpp"

namespace giga {

std::string PythonWriter::call(const std::string& function, const std::string& arguments) const {
  return cat(library_, ".", function, "(", arguments, ")");
}

std::string PythonWriter::operation(const ArrayOperation& op, const std::vector<std::string>& arguments) {
  const std::string name = op.python;
  if (std::isalpha(static_cast<unsigned char>(name[0]))) return call(name, join(arguments));
  GIGA_CHECK(arguments.size() == 2, name);
  return cat("(", arguments[0], " ", name, " ", arguments[1], ")");
}

std::string PythonWriter::number(float value) {
  const std::string text = print_number(value);
  return text.find_first_of(".e") == std::string::npos ? text + ".0" : text;
}

std::string PythonWriter::columns(const std::string& x, int first, int end) {
  return cat(x, "[:, ", first, ":", end, "]");
}

std::string PythonWriter::reshaped(const std::string& x, const std::vector<int>& sides) {
  std::string shape = "-1";
  for (const int side : sides) shape += cat(", ", side);
  return cat(x, ".reshape([", shape, "])");
}

std::string PythonWriter::feature(const std::string& x, int k) { return cat(x, "[:, :, ", k, "]"); }
std::string PythonWriter::running_sum(const std::string& x) { return call("cumsum", x + ", 1"); }
std::string PythonWriter::sum_of_items(const std::string& x) { return call("sum", x + ", 1"); }
std::string PythonWriter::least(const std::string& x) { return call("amin", x + ", 2"); }
std::string PythonWriter::joined(const std::vector<std::string>& parts) {
  return call("concatenate", cat("[", join(parts), "], 1"));
}

std::string PythonWriter::named(const std::string& name, const std::string& x) {
  const int use = ++uses_[name];
  const std::string unique = use == 1 ? name : cat(name, "_", use);
  code_ += cat(indent_, unique, " = ", x, "\n");
  return unique;
}

}  // namespace giga
