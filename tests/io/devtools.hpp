// A browser in real time, told what to do over Chromium's DevTools protocol: pictures are drawn as on a screen, keys
// are those of a keyboard, and CPU time is counted.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "child.hpp"
#include "core/error.hpp"
#include "io/files.hpp"

namespace giga::test {

class LiveBrowser {
 public:
  using Json = nlohmann::json;

  /// Opens an address. Files of the browser go into `folder`.
  LiveBrowser(const std::string& browser, const std::string& address, const std::filesystem::path& folder,
              const std::string& size) {
    int to[2], from[2];
    GIGA_CHECK(pipe(to) == 0 && pipe(from) == 0, "no pipe");
    write_.file = to[1];
    read_.file = from[0];
    const std::string profile = "--user-data-dir=" + (folder / "live_profile").string(),
                      window = "--window-size=" + size, log = (folder / "live.log").string();
    child_.pid = fork();
    GIGA_CHECK(child_.pid >= 0, "no process");
    if (child_.pid == 0) {
      setpgid(0, 0);
      // It reads commands from file 3 and writes to file 4.
      const int in = fcntl(to[0], F_DUPFD, 10), out = fcntl(from[1], F_DUPFD, 10);
      const int none = open("/dev/null", O_RDWR), errors = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
      for (const auto& [file, as] : {std::array{none, 0}, {none, 1}, {errors, 2}, {in, 3}, {out, 4}}) dup2(file, as);
      execlp(browser.c_str(), browser.c_str(), "--headless=new", "--no-sandbox", "--disable-gpu",
             "--remote-debugging-pipe", window.c_str(), profile.c_str(), "about:blank", nullptr);
      _exit(127);
    }
    setpgid(child_.pid, child_.pid);
    close(to[0]);
    close(from[1]);
    const auto last = Clock::now() + kPatience;
    while (session_.empty()) {  // the first page opens a moment after the browser answers
      const Json targets = call("Target.getTargets", {}, "");
      for (const Json& target : targets.at("targetInfos"))
        if (target.at("type") == "page")
          session_ = call("Target.attachToTarget", {{"targetId", target.at("targetId")}, {"flatten", true}}, "")
                         .at("sessionId");
      GIGA_CHECK(Clock::now() < last, "no page: ", read_file(log));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    call("Page.enable");
    call("Runtime.enable");
    call("Page.navigate", {{"url", address}});
  }
  LiveBrowser(const LiveBrowser&) = delete;
  LiveBrowser& operator=(const LiveBrowser&) = delete;

  /// The value of an expression; promises are waited for.
  Json value(const std::string& expression) {
    const Json answer =
        call("Runtime.evaluate", {{"expression", expression}, {"awaitPromise", true}, {"returnByValue", true}});
    GIGA_CHECK(!answer.contains("exceptionDetails"), expression, ": ", answer.dump());
    return answer.at("result").value("value", Json());
  }
  void wait_until(const std::string& expression) {
    const auto last = Clock::now() + kPatience;
    while (value("Boolean(" + expression + ")") != true) {
      GIGA_CHECK(Clock::now() < last, "waited in vain for ", expression);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  /// A key of the keyboard goes down or up: its code and its text, as KeyA and a.
  void key(bool down, const std::string& code, const std::string& text) {
    call("Input.dispatchKeyEvent", {{"type", down ? "rawKeyDown" : "keyUp"}, {"code", code}, {"key", text}});
  }
  /// The mouse presses the middle of an element: a selector of CSS.
  void click(const std::string& selector) {
    const Json at = value("(() => { const e = document.querySelector('" + selector +
                          "'); e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
                          " return [b.x + b.width / 2, b.y + b.height / 2]; })()");
    for (const char* type : {"mousePressed", "mouseReleased"})
      call("Input.dispatchMouseEvent",
           {{"type", type}, {"x", at[0]}, {"y", at[1]}, {"button", "left"}, {"clickCount", 1}});
  }
  /// CPU time of all processes of the browser until now, in seconds.
  double cpu_seconds() {
    double sum = 0;
    const Json processes = call("SystemInfo.getProcessInfo", {}, "");
    for (const Json& process : processes.at("processInfo")) sum += process.at("cpuTime").get<double>();
    return sum;
  }
  /// What went wrong in the page or was written to its console.
  const std::string& problems() const { return problems_; }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kPatience{60};

  Json call(const std::string& method, const Json& params = Json::object()) { return call(method, params, session_); }
  Json call(const std::string& method, const Json& params, const std::string& session) {
    Json message = {{"id", ++last_id_}, {"method", method}, {"params", params.is_null() ? Json::object() : params}};
    if (!session.empty()) message["sessionId"] = session;
    const std::string text = message.dump() + '\0';
    for (size_t at = 0; at < text.size();) {
      const ssize_t n = write(write_.file, text.data() + at, text.size() - at);
      GIGA_CHECK(n > 0, "the browser has ended");
      at += static_cast<size_t>(n);
    }
    const auto last = Clock::now() + kPatience;
    while (true) {
      const Json answer = next(last);
      const std::string event = answer.value("method", "");
      if (event == "Runtime.exceptionThrown" || event == "Runtime.consoleAPICalled") problems_ += answer.dump() + '\n';
      if (answer.value("id", -1) != last_id_) continue;
      GIGA_CHECK(!answer.contains("error"), method, ": ", answer.dump());
      return answer.at("result");
    }
  }
  /// The next message; each ends with a zero.
  Json next(Clock::time_point last) {
    size_t end = 0;
    while ((end = buffer_.find('\0')) == std::string::npos) {
      pollfd ready{read_.file, POLLIN, 0};
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(last - Clock::now()).count();
      GIGA_CHECK(left > 0 && poll(&ready, 1, static_cast<int>(left)) == 1, "the browser does not answer");
      char part[1 << 16];
      const ssize_t n = read(read_.file, part, sizeof part);
      GIGA_CHECK(n > 0, "the browser has ended");
      buffer_.append(part, static_cast<size_t>(n));
    }
    const Json message = Json::parse(buffer_.substr(0, end));
    buffer_.erase(0, end + 1);
    return message;
  }

  // Members of their own, so that the browser ends with the test where the constructor throws too.
  Pipe write_, read_;
  Child child_;
  int last_id_ = 0;
  std::string session_, buffer_, problems_;
};

}  // namespace giga::test
