// PseudoTerminal: a piece of program with stderr on a terminal of its own, and what is on the screen of that terminal.
#pragma once

#include <sys/types.h>

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "io/terminal/live_lines.hpp"

namespace giga::test {

/// Whether a terminal emulator (Python's pyte) is at hand; without it there is no screen() to look at.
bool has_terminal_emulator();

class PseudoTerminal {
 public:
  /// What the program calls to wait until the test has looked at the screen.
  using Pause = std::function<void()>;

  /// Starts `program` in a process of its own, with `environment` in place of the variables that say how to draw.
  PseudoTerminal(TerminalSize size, const std::map<std::string, std::string>& environment,
                 const std::function<void(const Pause&)>& program);
  ~PseudoTerminal();
  PseudoTerminal(const PseudoTerminal&) = delete;
  PseudoTerminal& operator=(const PseudoTerminal&) = delete;

  /// Lets the program run to its next pause or to its end; false at the end.
  bool run();
  void resize(TerminalSize size);

  /// All bytes so far.
  const std::string& output() const { return output_; }
  /// The rows of the screen down to the last that is not empty, each with a newline; then "cursor COLUMN ROW" (from 0).
  std::string screen() const { return emulate("show"); }
  /// The foreground colours on the screen as RRGGBB or "default", sorted.
  std::string colors() const { return emulate("colors"); }

 private:
  std::string emulate(const std::string& command) const;

  pid_t child_ = 0;
  int terminal_ = -1, go_ = -1;  // the terminal's other end; a byte here ends a pause
  std::string output_, events_;
  bool waiting_ = false;
};

}  // namespace giga::test
