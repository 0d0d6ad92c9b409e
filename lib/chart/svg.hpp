// Svg: a picture as SVG text, element by element.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace giga {

/// `name="value"`; lengths are pixels with two decimals.
struct SvgAttribute {
  std::string_view name;
  std::string value;

  SvgAttribute(std::string_view n, double v);
  SvgAttribute(std::string_view n, std::string v) : name(n), value(std::move(v)) {}
  SvgAttribute(std::string_view n, const char* v) : name(n), value(v) {}
};

/// Texts and values may hold anything: what XML reserves is escaped, what is no UTF-8 replaced.
class Svg {
 public:
  /// `description` is what a screen reader says.
  Svg(double width, double height, const std::string& description);
  /// An element of a page, which gives size and looks.
  explicit Svg(std::initializer_list<SvgAttribute> attributes) { begin("svg", attributes); }

  void add(std::string_view element, std::initializer_list<SvgAttribute> attributes);
  void text(const std::string& text, std::initializer_list<SvgAttribute> attributes);
  /// An element into which all goes until its end(); attributes without a value are left out.
  void begin(std::string_view element, std::initializer_list<SvgAttribute> attributes);
  void end(std::string_view element);
  /// A line of text that is shown while the pointer rests on the next element added.
  void hint(const std::string& text) { hint_ = text; }

  /// The whole picture.
  std::string finish() const { return out_ + "</svg>\n"; }

 private:
  void open(std::string_view element, std::initializer_list<SvgAttribute> attributes);

  std::string out_, hint_;
};

/// The look that all pictures share: colours, pixels.
constexpr const char *kInk = "#1c2430", *kQuiet = "#5d6878";
constexpr double kMargin = 20, kHeadingHeight = 70, kTitleSize = 17, kTextSize = 13;

/// "12.5": at most two decimals, no zeros behind.
std::string svg_number(double value);

/// About the width of a text in pixels, in the font that Svg asks for.
double text_width(const std::string& text, double font_size);

}  // namespace giga
