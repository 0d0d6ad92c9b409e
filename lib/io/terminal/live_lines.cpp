// Drawing lines in place with ANSI escape sequences.
#include "io/terminal/live_lines.hpp"

#include <errno.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

namespace giga {
namespace {

constexpr const char* kEraseToLineEnd = "\x1b[K";
constexpr const char* kEraseBelow = "\x1b[J";

}  // namespace

bool stderr_is_terminal() {
  const char* term = std::getenv("TERM");
  return ::isatty(STDERR_FILENO) == 1 && term && std::string_view(term) != "dumb";
}

TerminalSize LiveLines::size() const {
  winsize size{};
  if (::ioctl(file_, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) return {};
  return {size.ws_col, size.ws_row};
}

/// From below the lines to the beginning of the first one. Rows are erased one by one where lines wrapped, since some
/// terminals keep what "erase below" takes from the whole screen in their scroll-back.
std::string LiveLines::to_top(int columns) const {
  int rows = 0;
  for (const int width : widths_) rows += std::max(1, (width + columns - 1) / columns);
  if (rows == 0) return "\r";
  std::string up = "\r\x1b[" + std::to_string(rows) + "A";
  if (rows == static_cast<int>(widths_.size())) return up;
  std::string text = up;
  for (int k = 0; k < rows; ++k) text += "\x1b[2K\x1b[B";
  return text + up;
}

/// Each line overwrites the old one, and only then the rest is erased: nothing flickers.
std::string LiveLines::drawn() const {
  std::string text;
  for (const std::string& line : lines_) text += line + kEraseToLineEnd + "\n";
  return text + kEraseBelow;
}

void LiveLines::show(const std::vector<Line>& lines, TerminalStyle style) {
  std::vector<std::string> printed;
  for (const Line& line : lines) printed.push_back(line.print(style));
  const int columns = size().columns;
  if (printed == lines_ && columns == columns_) return;

  std::string frame = to_top(columns);
  lines_ = std::move(printed);
  widths_.clear();
  for (const Line& line : lines) widths_.push_back(line.width());
  columns_ = columns;
  write(frame + drawn());
}

void LiveLines::print(std::string_view text) {
  if (lines_.empty()) return write(text);
  const int columns = size().columns;
  std::string frame = to_top(columns);
  for (const char c : text) {
    if (c == '\n') frame += kEraseToLineEnd;
    frame += c;
  }
  // Lines that do not fit any more wait for the next show().
  if (*std::max_element(widths_.begin(), widths_.end()) >= columns) leave();
  write(frame + drawn());
}

void LiveLines::leave() {
  lines_.clear();
  widths_.clear();
}

void LiveLines::write(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t n = ::write(file_, bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return;
    bytes.remove_prefix(static_cast<size_t>(n));
  }
}

}  // namespace giga
