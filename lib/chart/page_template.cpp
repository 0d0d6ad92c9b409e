#include "chart/page_template.hpp"

#include "core/error.hpp"

namespace giga {

std::string fill_template(std::string_view page, const std::map<std::string, std::string>& texts) {
  std::string out;
  for (size_t at = 0;;) {
    const size_t begin = page.find("{{", at), end = page.find("}}", begin);
    out += page.substr(at, begin == std::string_view::npos ? begin : begin - at);
    if (begin == std::string_view::npos) return out;
    const auto text = texts.find(std::string(page.substr(begin + 2, end - begin - 2)));
    GIGA_CHECK(text != texts.end(), "the page has a place ", page.substr(begin, end + 2 - begin));
    out += text->second;
    at = end + 2;
  }
}

}  // namespace giga
