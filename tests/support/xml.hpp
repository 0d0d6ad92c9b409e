// Reading of XML, strict, as far as our pictures need it.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace giga::test {

struct XmlElement {
  std::string name, parent;
  std::map<std::string, std::string> attributes;
  std::string text;  ///< directly in it
};

/// All elements in the order of their beginning. Throws Error where the text is not well-formed: tags that do not
/// match, attributes twice or without quotes, bare "&" or "<", something behind the root.
std::vector<XmlElement> parse_xml(std::string_view text);

}  // namespace giga::test
