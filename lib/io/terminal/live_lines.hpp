// LiveLines: lines at the bottom of a terminal that are drawn anew in place, with messages scrolling by above them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "io/terminal/line.hpp"

namespace giga {

struct TerminalSize {
  int columns = 80, rows = 24;
};

/// Whether stderr is a terminal that understands cursor movements.
bool stderr_is_terminal();

/// Between two calls the cursor stands at the beginning of the line below the live lines and is never hidden, so that a
/// program that is killed leaves the terminal in order. Each call writes once. Where the file is no terminal, show
/// nothing. A write that fails is left out: a run goes on when its terminal is gone.
///
/// When a terminal gets narrower than the lines, most terminals wrap them and some cut them. The next call erases as
/// if they were wrapped. Where they were cut, it also erases some lines of output above; old lines never remain.
/// Lines that the terminal has pushed out at the top stay in its scroll-back.
///
/// Not safe against calls from several threads.
class LiveLines {
 public:
  explicit LiveLines(int file) : file_(file) {}

  /// Now: asked for at each call. 80 x 24 where the file has no size.
  TerminalSize size() const;
  /// Replaces the live lines. They must be narrower than the terminal and fewer than its rows, or they scroll away.
  /// Nothing is written if they are as they were.
  void show(const std::vector<Line>& lines, TerminalStyle style);
  /// Writes `text`, which ends with a newline, above the lines.
  void print(std::string_view text);
  /// The lines stay where they are, and what is written next stands below.
  void leave();

 private:
  std::string to_top(int columns) const;
  std::string drawn() const;
  void write(std::string_view bytes) const;

  int file_;
  std::vector<std::string> lines_;
  std::vector<int> widths_;
  int columns_ = 0;  // of the terminal when they were drawn
};

}  // namespace giga
