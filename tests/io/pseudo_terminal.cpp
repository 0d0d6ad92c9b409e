// A program under forkpty, and its output fed to an emulator.
#include "pseudo_terminal.hpp"

#include <errno.h>
#include <pty.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>

#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "support/source.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

constexpr const char* kPauseMark = "\x1b]2;pause\x07";  // sets the title of a window: nothing on the screen

std::string python() { return python_with("pyte"); }

std::string event(const char* name, TerminalSize size) { return cat(name, " ", size.columns, " ", size.rows, "\n"); }

std::string event(const char* name, const std::string& bytes) {
  std::string text = std::string(name) + " ";
  for (const char byte : bytes) {
    char hex[3];
    std::snprintf(hex, sizeof hex, "%02x", static_cast<unsigned char>(byte));
    text += hex;
  }
  return text + "\n";
}

winsize window(TerminalSize size) {
  winsize w{};
  w.ws_col = static_cast<unsigned short>(size.columns);
  w.ws_row = static_cast<unsigned short>(size.rows);
  return w;
}

/// The child process: never returns.
[[noreturn]] void run_program(int go, const std::map<std::string, std::string>& environment,
                              const std::function<void(const PseudoTerminal::Pause&)>& program) {
  for (const char* name : {"NO_COLOR", "LC_ALL", "LC_CTYPE", "LANG"}) ::unsetenv(name);
  ::setenv("TERM", "xterm-256color", 1);
  for (const auto& [name, value] : environment) ::setenv(name.c_str(), value.c_str(), 1);
  try {
    program([go] {
      std::fputs(kPauseMark, stderr);
      char byte = 0;
      if (::read(go, &byte, 1) != 1) ::_exit(3);
    });
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    ::_exit(1);
  }
  ::_exit(0);
}

}  // namespace

bool has_terminal_emulator() { return !python().empty(); }

PseudoTerminal::PseudoTerminal(TerminalSize size, const std::map<std::string, std::string>& environment,
                               const std::function<void(const Pause&)>& program)
    : events_(event("size", size)) {
  int pipe[2];
  GIGA_CHECK(::pipe(pipe) == 0, errno);
  const winsize w = window(size);
  child_ = ::forkpty(&terminal_, nullptr, nullptr, &w);
  GIGA_CHECK(child_ >= 0, errno);
  if (child_ == 0) {
    ::close(pipe[1]);
    run_program(pipe[0], environment, program);
  }
  ::close(pipe[0]);
  go_ = pipe[1];
}

PseudoTerminal::~PseudoTerminal() {
  ::close(go_);  // ends the program where it is paused
  ::close(terminal_);
  ::waitpid(child_, nullptr, 0);
}

bool PseudoTerminal::run() {
  if (waiting_) GIGA_CHECK(::write(go_, "x", 1) == 1, errno);
  std::string bytes;
  const std::string mark = kPauseMark;
  // A terminal whose program has ended reads as an error.
  char block[4096];
  for (ssize_t n = 0; !bytes.ends_with(mark) && (n = ::read(terminal_, block, sizeof block)) > 0;)
    bytes.append(block, static_cast<size_t>(n));
  waiting_ = bytes.ends_with(mark);
  if (waiting_) bytes.resize(bytes.size() - mark.size());
  output_ += bytes;
  if (!bytes.empty()) events_ += event("feed", bytes);
  return waiting_;
}

void PseudoTerminal::resize(TerminalSize size) {
  const winsize w = window(size);
  GIGA_CHECK(::ioctl(terminal_, TIOCSWINSZ, &w) == 0, errno);
  events_ += event("size", size);
}

std::string PseudoTerminal::emulate(const std::string& command) const {
  const TemporaryFolder folder;
  const std::string in = (folder / "in").string(), out = (folder / "out").string();
  std::ofstream(in) << events_ << command << "\n";
  const std::string line = shell_word(python()) + " " + shell_word(source_path("tests/io/screen.py")) + " <" +
                           shell_word(in) + " >" + shell_word(out);
  GIGA_CHECK(std::system(line.c_str()) == 0, line);
  return read_file(out);
}

}  // namespace giga::test
