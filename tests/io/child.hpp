// A process of a test and the ends of its pipes: gone with the test.
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

namespace giga::test {

/// One end of a pipe.
struct Pipe {
  Pipe() = default;
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe() {
    if (file >= 0) close(file);
  }

  int file = -1;
};

/// A process that leads a group of its own, which ends with it.
struct Child {
  Child() = default;
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (pid <= 0) return;
    kill(-pid, SIGKILL);
    waitpid(pid, nullptr, 0);
  }

  int pid = -1;
};

}  // namespace giga::test
