// Pages of ours in a real browser: a script uses the page as a reader does, and writes down what it sees.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "config/document.hpp"
#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "io/temporary_folder.hpp"
#include "support/source.hpp"

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

using Texts = std::vector<std::string>;
/// What a check saw: one thing, or a list of them.
inline std::string text(const Document& seen, const char* key) {
  const Node* node = seen.root.find(key);
  GIGA_CHECK(node, "the check saw no ", key);
  return node->text;
}
inline Texts texts(const Document& seen, const char* key) {
  const Node* node = seen.root.find(key);
  GIGA_CHECK(node, "the check saw no ", key);
  Texts all;
  for (const Node& item : node->items) all.push_back(item.text);
  return all;
}

inline std::string from_hex(const std::string& hex) {
  std::string bytes;
  for (size_t k = 0; k + 1 < hex.size(); k += 2) bytes += static_cast<char>(std::stoi(hex.substr(k, 2), nullptr, 16));
  return bytes;
}

class InBrowser : public testing::Test {
 protected:
  void SetUp() override {
    browser_ = find_browser();
    if (browser_.empty()) GTEST_SKIP() << "no Chromium here";
  }

  /// Opens a page from disk with the check of a folder of tests (browser_check.js) at its end, behind `constants`, and
  /// returns what its usePage() saw; `problems` there holds the errors since the page's beginning. Fails the test where
  /// the console says anything.
  Document use(const std::string& html, const std::string& tests, const std::string& constants,
               const std::string& options) const {
    const auto check = [](const std::string& name) {
      return read_file(source_path("tests/" + name + "/browser_check.js"));
    };
    const std::filesystem::path page = folder_ / "page.html", dom = folder_ / "dom.html", log = folder_ / "browser.log";
    std::string text = html;
    const std::string first = "<body>", last = "</body>", start = "<pre id=\"outcome\">";
    const size_t end = text.rfind(last), begin = text.find(first);
    GIGA_CHECK(begin != std::string::npos && end != std::string::npos, "no body");
    // A block: the page has names of its own.
    text.insert(end, "<script>{\n" + constants + check("io") + check(tests) +
                         "\nusePage().catch(error => { problems.push(String(error.stack || error)); return {}; })"
                         ".then(seen => {"
                         "const outcome = document.body.appendChild(document.createElement('pre'));"
                         "outcome.id = 'outcome'; outcome.textContent = JSON.stringify({...seen, problems}); });"
                         "}</script>");
    // A browser that only prints the page makes no pictures by itself.
    text.insert(begin + first.size(),
                "<script>window.requestAnimationFrame = f => setTimeout(() => f(performance.now()), 16);"
                "const problems = []; addEventListener('error', e => problems.push(e.message));"
                "addEventListener('securitypolicyviolation', e => problems.push(e.blockedURI));"
                "addEventListener('unhandledrejection', e => problems.push(String(e.reason)));</script>");
    std::ofstream(page, std::ios::binary) << text;
    const std::string command = "timeout 300 " + browser_ +
                                " --headless=new --no-sandbox --disable-gpu --virtual-time-budget=20000"
                                " --enable-logging=stderr --dump-dom " +
                                options + " --user-data-dir=" + shell_word((folder_ / "profile").string()) + " " +
                                shell_word("file://" + page.string()) + " >" + shell_word(dom.string()) + " 2>" +
                                shell_word(log.string()) + " </dev/null";
    EXPECT_EQ(shell(command), 0) << read_file(log);
    EXPECT_EQ(read_file(log).find("CONSOLE"), std::string::npos) << read_file(log);
    const std::string drawn = read_file(dom);
    const size_t at = drawn.rfind(start);
    GIGA_CHECK(at != std::string::npos, "the page's check did not come to its end: ", read_file(log));
    return parse_yaml_text(drawn.substr(at + start.size(), drawn.find("</pre>", at) - at - start.size()), "outcome");
  }

  std::string browser_;
  TemporaryFolder folder_;
};

}  // namespace giga::test
