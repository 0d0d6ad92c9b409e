// A web server of this machine alone, as long as a test needs it: Python's.
#pragma once

#include <fcntl.h>

#include <filesystem>
#include <string>

#include "child.hpp"
#include "core/error.hpp"

namespace giga::test {

class WebServer {
 public:
  /// Serves the files of a folder at a port that is free.
  WebServer(const std::string& python, const std::filesystem::path& folder) {
    int said[2];
    GIGA_CHECK(pipe2(said, O_CLOEXEC) == 0, "no pipe");
    said_.file = said[0];
    child_.pid = fork();
    GIGA_CHECK(child_.pid >= 0, "no process");
    if (child_.pid == 0) {
      setpgid(0, 0);
      const int none = open("/dev/null", O_RDWR);
      dup2(none, 0);
      dup2(said[1], 1);
      dup2(none, 2);
      execlp(python.c_str(), python.c_str(), "-u", "-m", "http.server", "--bind", "127.0.0.1", "--directory",
             folder.c_str(), "0", nullptr);
      _exit(127);
    }
    setpgid(child_.pid, child_.pid);
    close(said[1]);
    // "Serving HTTP on 127.0.0.1 port 40123 (http://127.0.0.1:40123/) ..."
    std::string line;
    for (char c; read(said_.file, &c, 1) == 1 && c != '\n';) line += c;
    const size_t begin = line.find("(http://"), end = line.find(')');
    GIGA_CHECK(begin != std::string::npos && end != std::string::npos, "no web server: ", line);
    address_ = line.substr(begin + 1, end - begin - 1);
  }

  /// Ends with a slash.
  const std::string& address() const { return address_; }

 private:
  Pipe said_;
  Child child_;
  std::string address_;
};

}  // namespace giga::test
