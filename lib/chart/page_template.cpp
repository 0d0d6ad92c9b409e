#include "chart/page_template.hpp"

#include "chart/markup.hpp"
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

std::string embedded_file(std::optional<std::string_view> (*find)(std::string_view), std::string_view name) {
  const std::optional<std::string_view> bytes = find(name);
  GIGA_CHECK(bytes, "no file ", name, " in the program");
  return std::string(*bytes);
}

std::string page_head(const PageHead& head) {
  const std::string style = head.style_file.empty() ? cat("<style>", head.style, "</style>")
                                                    : cat("<link rel=\"stylesheet\" href=\"", head.style_file, "\">");
  return cat("<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n",
             "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src ", head.source,
             "; script-src ", head.source, head.more_scripts.empty() ? "" : " ", head.more_scripts,
             head.connect.empty() ? "" : "; connect-src ", head.connect, "; img-src data:\">\n",
             "<link rel=\"icon\" href=\"data:,\">\n<title>", escaped(head.title), " - gigastep ", head.kind,
             "</title>\n", style);
}

}  // namespace giga
