// Reading of pages.
#include "read_page.hpp"

#include <algorithm>

#include "core/error.hpp"

namespace giga::test {

Elements section_of(const std::string& page, const std::string& title) {
  const size_t begin = page.find("<main"), end = page.find("</main>");
  GIGA_CHECK(begin < end && end != std::string::npos, "a page without a main part");
  const Elements all = parse_xml(page.substr(begin, end + 7 - begin));
  const auto is_section = [](const XmlElement& e) { return e.name == "section"; };
  for (auto at = std::find_if(all.begin(), all.end(), is_section); at != all.end();) {
    const auto next = std::find_if(at + 1, all.end(), is_section);
    const Elements section(at, next);
    if (texts_of(section, "h2") == Texts{title}) return section;
    at = next;
  }
  return {};
}

Texts texts_of(const Elements& elements, const std::string& name, const std::string& of_class) {
  Texts texts;
  for (const XmlElement& e : elements) {
    const auto own_class = e.attributes.find("class");
    if (e.name != name || (!of_class.empty() && (own_class == e.attributes.end() || own_class->second != of_class)))
      continue;
    texts.push_back(e.text);
  }
  return texts;
}

std::vector<Rows> tables_of(const Elements& section) {
  std::vector<Rows> tables;
  bool in_body = false;
  for (const XmlElement& e : section) {
    if (e.name == "table") tables.emplace_back();
    if (e.name == "thead" || e.name == "tbody") in_body = e.name == "tbody";
    if (e.name == "tr" && in_body) tables.back().emplace_back();
    if (e.name == "td") tables.back().back().push_back(e.text);
  }
  return tables;
}

}  // namespace giga::test
