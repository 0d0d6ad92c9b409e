// Pages of ours in a real browser: a script uses the page as a reader does, and writes down what it sees.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "config/document.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "io/shell_word.hpp"

namespace giga::test {

inline int shell(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// A Chromium that starts; "" where there is none. (Where the system's package is a snap, the command is there but
/// fails.)
inline std::string find_browser() {
  for (const char* name : {"chromium", "chromium-browser", "google-chrome"})
    if (shell(std::string("timeout 60 ") + name + " --version >/dev/null 2>&1") == 0) return name;
  return "";
}

/// Opens a page from disk with `check`, a script, at its end. The script leaves JSON in an element <pre id="outcome">;
/// `problems` there holds the errors since the page's beginning. Fails the test where the console says anything.
inline Document use_page(const std::string& browser, const std::string& html, const std::string& check,
                         const std::filesystem::path& folder, const std::string& options) {
  const std::filesystem::path page = folder / "page.html", dom = folder / "dom.html", log = folder / "browser.log";
  std::string text = html;
  const auto replace = [&text](const std::string& from, const std::string& to) {
    const size_t at = text.rfind(from);
    GIGA_CHECK(at != std::string::npos, "no '", from, "'");
    text.replace(at, from.size(), to);
  };
  replace("</body>", "<script>" + check + "</script></body>");
  const std::string first = "<body>";
  const size_t at = text.find(first);
  GIGA_CHECK(at != std::string::npos, "no body");
  text.insert(at + first.size(),
              // A browser that only prints the page makes no pictures by itself.
              "<script>window.requestAnimationFrame = f => setTimeout(() => f(performance.now()), 16);"
              "const problems = []; addEventListener('error', e => problems.push(e.message));"
              "addEventListener('securitypolicyviolation', e => problems.push(e.blockedURI));"
              "addEventListener('unhandledrejection', e => problems.push(String(e.reason)));</script>");
  std::ofstream(page, std::ios::binary) << text;
  const std::string command = "timeout 120 " + browser +
                              " --headless=new --no-sandbox --disable-gpu --virtual-time-budget=20000"
                              " --enable-logging=stderr --dump-dom " +
                              options + " --user-data-dir=" + shell_word((folder / "profile").string()) + " " +
                              shell_word("file://" + page.string()) + " >" + shell_word(dom.string()) + " 2>" +
                              shell_word(log.string()) + " </dev/null";
  EXPECT_EQ(shell(command), 0) << read_file(log);
  EXPECT_EQ(read_file(log).find("CONSOLE"), std::string::npos) << read_file(log);
  const std::string drawn = read_file(dom), start = "<pre id=\"outcome\">";
  const size_t begin = drawn.rfind(start);
  GIGA_CHECK(begin != std::string::npos, "the page's check did not come to its end: ", read_file(log));
  const size_t end = drawn.find("</pre>", begin);
  return parse_yaml_text(drawn.substr(begin + start.size(), end - begin - start.size()), "outcome");
}

}  // namespace giga::test
