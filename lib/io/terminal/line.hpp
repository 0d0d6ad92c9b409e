// Line: a line of text for a terminal, in which every character takes one column and parts have their ink.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace giga {

/// What the terminal at hand can show.
struct TerminalStyle {
  bool color = true;
  bool unicode = true;  ///< else ASCII
};

/// By the environment. No colour where NO_COLOR is set to anything or TERM is dumb; characters beyond ASCII where the
/// locale (LC_ALL, LC_CTYPE, LANG) is a UTF-8 one, but not on the Linux console, whose font lacks them.
TerminalStyle terminal_style();

/// The inks of a panel. Colours are of the 256-colour set and readable on dark and on light ground.
enum class Ink : uint8_t { plain, strong, dim, team_0, team_1 };

class Line {
 public:
  /// UTF-8. What is not known to take exactly one column (control, combining and wide characters) becomes '?'.
  Line& add(std::string_view text, Ink ink = Ink::plain);
  /// The next text begins at `column`, or where this line ends if that is further right.
  Line& at(int column);
  /// Text that ends before `column`.
  Line& add_right(std::string_view text, int column, Ink ink = Ink::plain);

  /// Columns taken; there are no spaces at the end that were not added as text.
  int width() const { return width_; }
  /// Cuts what is beyond `width` columns, and spaces at the end then.
  void clip(int width);
  /// With escape sequences for the inks, which end at the end of the line, or without any.
  std::string print(TerminalStyle style) const;

 private:
  struct Part {
    std::string text;
    Ink ink;
  };
  std::vector<Part> parts_;
  int width_ = 0, next_ = 0;
};

/// Columns of a text that a Line takes as it is.
int columns_of(std::string_view text);

}  // namespace giga
