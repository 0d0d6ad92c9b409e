// Writing of SVG and HTML.
#include "chart/markup.hpp"

#include <cstdio>

#include "core/error.hpp"
#include "core/utf8.hpp"

namespace giga {

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : printable_utf8(text)) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else {
      out += c;
    }
  }
  return out;
}

Attribute::Attribute(std::string_view n, double v) : name(n), value(svg_number(v)) {}

std::string svg_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  std::string number = text;
  number.erase(number.find_last_not_of('0') + 1);
  if (number.ends_with('.')) number.pop_back();
  return number == "-0" ? "0" : number;
}

double text_width(const std::string& text, double font_size) {
  double ems = 0;  // of a sans-serif font
  for (size_t at = 0; at < text.size();) {
    const char c = text[at];
    const bool narrow = std::string_view(" .,:;'|!()[]fijlrt-").find(c) != std::string_view::npos;
    const bool wide = (c >= 'A' && c <= 'Z') || c == 'm' || c == 'w' || c == '@' || c == '%' || c == '_';
    ems += narrow ? 0.36 : wide ? 0.74 : 0.6;
    const size_t length = utf8_length(text, at);
    at += length ? length : 1;
  }
  return ems * font_size;
}

void Markup::start(std::string_view element, Attributes attributes) {
  out_ += cat("<", element);
  for (const Attribute& a : attributes)
    if (!a.value.empty()) out_ += cat(" ", a.name, "=\"", escaped(a.value), "\"");
}

Markup::Scope Markup::open(std::string_view element, Attributes attributes) {
  start(element, attributes);
  out_ += ">\n";
  return {*this, element};
}

void Markup::element(std::string_view element, const std::string& text, Attributes attributes) {
  start(element, attributes);
  out_ += cat(">", escaped(text), "</", element, ">\n");
}

void Markup::add(std::string_view element, Attributes attributes) {
  start(element, attributes);
  out_ += hint_.empty() ? "/>\n" : cat("><title>", escaped(hint_), "</title></", element, ">\n");
  hint_.clear();
}

Markup::Scope open_picture(Markup& svg, double width, double height, const std::string& description) {
  const std::string w = svg_number(width), h = svg_number(height);
  svg.insert(
      cat("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"", w, "\" height=\"", h, "\" viewBox=\"0 0 ", w, " ", h,
          "\" role=\"img\" font-family=\"system-ui, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif\">\n"));
  svg.element("desc", description);
  svg.add("rect", {{"width", width}, {"height", height}, {"fill", "#ffffff"}});
  return {svg, "svg"};
}

}  // namespace giga
