// Markup: SVG and HTML as text, element by element.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace giga {

/// `name="value"`; lengths are pixels with two decimals. One without a value is left out.
struct Attribute {
  std::string_view name;
  std::string value;

  Attribute(std::string_view n, double v);
  Attribute(std::string_view n, std::string v) : name(n), value(std::move(v)) {}
  Attribute(std::string_view n, const char* v) : name(n), value(v) {}
};
using Attributes = std::initializer_list<Attribute>;

/// Texts and values may hold anything: what XML reserves is escaped, what is no UTF-8 replaced.
class Markup {
 public:
  /// What is written while it lives goes into an element.
  class Scope {
   public:
    Scope(Markup& markup, std::string_view element) : markup_(markup), element_(element) {}
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    ~Scope() { markup_.out_.append("</").append(element_).append(">\n"); }

   private:
    Markup& markup_;
    std::string_view element_;
  };

  /// An element into which others go.
  [[nodiscard]] Scope open(std::string_view element, Attributes attributes = {});
  /// An element that holds a text.
  void element(std::string_view element, const std::string& text, Attributes attributes = {});
  /// An element of SVG that holds nothing.
  void add(std::string_view element, Attributes attributes);
  void text(const std::string& text, Attributes attributes) { element("text", text, attributes); }
  /// A line of text that is shown while the pointer rests on the next element of add().
  void hint(const std::string& text) { hint_ = text; }
  /// Markup as it is.
  void insert(std::string_view markup) { out_ += markup; }

  const std::string& str() const { return out_; }

 private:
  void start(std::string_view element, Attributes attributes);

  std::string out_, hint_;
};

/// The outermost element of a file; `description` is what a screen reader says.
[[nodiscard]] Markup::Scope open_picture(Markup& svg, double width, double height, const std::string& description);

/// A text with what XML reserves escaped.
std::string escaped(std::string_view text);

/// The look that all pictures share: colours, pixels.
constexpr const char *kInk = "#1c2430", *kQuiet = "#5d6878";
constexpr double kMargin = 20, kHeadingHeight = 70, kTitleSize = 17, kTextSize = 13;

/// "12.5": at most two decimals, no zeros behind.
std::string svg_number(double value);

/// About the width of a text in pixels, in the font that pictures ask for.
double text_width(const std::string& text, double font_size);

}  // namespace giga
