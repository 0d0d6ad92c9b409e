#include "support/xml.hpp"

#include <cctype>

#include "core/error.hpp"

namespace giga::test {
namespace {

class Parser {
 public:
  explicit Parser(std::string_view text) : text_(text) {}

  std::vector<XmlElement> parse() {
    element("");
    skip_space();
    GIGA_CHECK(at_ == text_.size(), "something behind the root at ", at_);
    return std::move(elements_);
  }

 private:
  char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  void expect(std::string_view what) {
    GIGA_CHECK(text_.substr(at_, what.size()) == what, "no '", what, "' at ", at_, ": ", text_.substr(at_, 40));
    at_ += what.size();
  }
  void skip_space() {
    while (std::isspace(static_cast<unsigned char>(peek()))) ++at_;
  }
  std::string name() {
    const size_t begin = at_;
    while (std::isalnum(static_cast<unsigned char>(peek())) || peek() == '-') ++at_;
    GIGA_CHECK(at_ > begin, "no name at ", at_);
    return std::string(text_.substr(begin, at_ - begin));
  }
  std::string character() {
    GIGA_CHECK(peek() != '<' && peek() != '\0', "'<' or the end at ", at_);
    if (peek() != '&') return std::string(1, text_[at_++]);
    for (const auto& [entity, meaning] : {std::pair{"&amp;", "&"}, {"&lt;", "<"}, {"&gt;", ">"}, {"&quot;", "\""}})
      if (text_.substr(at_).starts_with(entity)) {
        at_ += std::string_view(entity).size();
        return meaning;
      }
    throw Error(cat("a bare & at ", at_));
  }

  void element(const std::string& parent) {
    expect("<");
    const size_t index = elements_.size();
    elements_.push_back({name(), parent, {}, ""});
    const std::string own = elements_[index].name;
    for (skip_space(); peek() != '>' && peek() != '/'; skip_space()) {
      const std::string attribute = name();
      expect("=\"");
      std::string value;
      while (peek() != '"') value += character();
      expect("\"");
      GIGA_CHECK(elements_[index].attributes.emplace(attribute, value).second, attribute, " twice");
    }
    if (peek() == '/') return expect("/>");
    expect(">");
    while (!text_.substr(at_).starts_with("</")) {
      if (peek() == '<') {
        element(own);
      } else {
        elements_[index].text += character();
      }
    }
    expect("</" + own + ">");
  }

  std::string_view text_;
  size_t at_ = 0;
  std::vector<XmlElement> elements_;
};

}  // namespace

std::vector<XmlElement> parse_xml(std::string_view text) { return Parser(text).parse(); }

}  // namespace giga::test
