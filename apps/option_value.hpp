// Values of options: read, limited and told as those of keys in files.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "config/fields.hpp"
#include "config/names.hpp"

namespace giga {

/// What help shows of the limits behind the name of a value: "[1, 256]"; nothing where there is one limit or none.
inline std::string shown_limits(const Allowed& allowed) {
  const std::string text = allowed.limits_text();
  return text.starts_with(" in ") ? text.substr(4) : "";
}

/// For CLI::Option::transform: a number, or one of some texts, as a key takes it (1e4 and 10_000 are integers too).
template <class T>
CLI::Validator value_of(const Allowed& allowed) {
  const auto read = [allowed](std::string& text) -> std::string {
    Node node;
    node.kind = Node::Kind::scalar;
    node.text = text;
    node.at.source = std::make_shared<std::string>();
    Errors errors;
    T value{};
    if (FieldCodec<T>::read(node, value, allowed, ReadSite{"", errors})) {
      // CLI11 reads the digits again. A text stays as it is, without the quotes of YAML.
      if constexpr (!std::is_same_v<T, std::string>) text = FieldCodec<T>::print(value);
      return "";
    }
    const std::string message = errors.text();  // without file and key, which CLI11 puts before it as the option's name
    return message.substr(message.find_first_not_of(": "));
  };
  return {read, shown_limits(allowed)};
}

/// For CLI::Option::check: a name that is given is not empty, as one of an unset variable of a shell is.
inline CLI::Validator some_name(const std::string& otherwise = "a name is missing") {
  return {[otherwise](std::string& text) { return text.empty() ? otherwise : std::string(); }, ""};
}

}  // namespace giga
