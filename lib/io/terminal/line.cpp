// A line of a terminal: widths, inks, and what the environment says of the terminal.
#include "io/terminal/line.hpp"

#include <algorithm>
#include <cstdlib>

#include "core/utf8.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

bool is_continuation(char byte) { return (static_cast<unsigned char>(byte) & 0xC0) == 0x80; }

unsigned code_point(std::string_view character) {
  const auto byte = [&](size_t k) { return static_cast<unsigned>(static_cast<unsigned char>(character[k])); };
  if (character.size() == 1) return byte(0);
  unsigned code = byte(0) & (0xFFu >> (character.size() + 1));
  for (size_t k = 1; k < character.size(); ++k) code = code << 6 | (byte(k) & 0x3F);
  return code;
}

/// Latin, Greek and Cyrillic letters, and the lines and blocks that panels are drawn with.
bool takes_one_column(unsigned code) {
  const auto within = [&](unsigned from, unsigned to) { return code >= from && code <= to; };
  return within(0x20, 0x7E) || (within(0xA0, 0x2FF) && code != 0xAD) || within(0x370, 0x482) || within(0x2500, 0x259F);
}

/// The text with '?' for each character that `fits` refuses, and for bytes that are no UTF-8.
template <class Fits>
std::string replaced(std::string_view text, Fits fits) {
  std::string out;
  for (size_t at = 0; at < text.size();) {
    const size_t length = utf8_length(text, at);
    const std::string_view character = text.substr(at, std::max<size_t>(length, 1));
    out += length > 0 && fits(code_point(character)) ? character : "?";
    at += character.size();
  }
  return out;
}

/// None where n < 0.
std::string first_columns(std::string_view text, int n) {
  size_t end = 0;
  for (int seen = 0; end < text.size() && (is_continuation(text[end]) || seen++ < n);) ++end;
  return std::string(text.substr(0, end));
}

const char* escape(Ink ink) {
  switch (ink) {
    case Ink::plain:
      return "";
    case Ink::strong:
      return "\x1b[1m";
    case Ink::dim:
      return "\x1b[38;5;244m";
    case Ink::team_0:
      return "\x1b[38;5;33m";
    case Ink::team_1:
      return "\x1b[38;5;208m";
  }
  return "";
}

std::string_view environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

}  // namespace

TerminalStyle terminal_style() {
  const std::string_view term = environment("TERM");
  std::string locale;
  for (const char* name : {"LC_ALL", "LC_CTYPE", "LANG"})
    if (locale.empty()) locale = environment(name);
  std::transform(locale.begin(), locale.end(), locale.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; });
  const bool utf8 = locale.find("utf-8") != std::string::npos || locale.find("utf8") != std::string::npos;
  return {environment("NO_COLOR").empty() && term != "dumb", utf8 && term != "linux"};
}

int columns_of(std::string_view text) {
  return static_cast<int>(std::count_if(text.begin(), text.end(), [](char byte) { return !is_continuation(byte); }));
}

Line& Line::add(std::string_view text, Ink ink) {
  if (text.empty()) return *this;
  if (next_ > width_) parts_.push_back({std::string(static_cast<size_t>(next_ - width_), ' '), Ink::plain});
  parts_.push_back({replaced(text, takes_one_column), ink});
  next_ = width_ = std::max(width_, next_) + columns_of(parts_.back().text);
  return *this;
}

Line& Line::at(int column) {
  next_ = std::max(column, width_);
  return *this;
}

Line& Line::add_right(std::string_view text, int column, Ink ink) {
  return at(column - columns_of(text)).add(text, ink);
}

void Line::clip(int width) {
  if (width_ <= width) return;
  while (width_ > std::max(width, 0)) {
    std::string& text = parts_.back().text;
    const int columns = columns_of(text);
    text = first_columns(text, columns - (width_ - width));
    width_ -= columns - columns_of(text);
    if (text.empty()) parts_.pop_back();
  }
  while (!parts_.empty() && parts_.back().text.ends_with(' ')) {
    parts_.back().text.pop_back();
    --width_;
    if (parts_.back().text.empty()) parts_.pop_back();
  }
  next_ = width_;
}

std::string Line::print(TerminalStyle style) const {
  std::string out;
  for (const auto& [text, ink] : parts_) {
    const bool inked = style.color && ink != Ink::plain;
    if (inked) out += escape(ink);
    out += style.unicode ? text : replaced(text, [](unsigned code) { return code < 0x80; });
    if (inked) out += "\x1b[m";
  }
  return out;
}

}  // namespace giga
