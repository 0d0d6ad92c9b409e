// The panel on a real terminal: what a person sees while messages come and the window changes its size.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>

#include "io/files.hpp"
#include "io/progress.hpp"
#include "io/terminal/panel.hpp"
#include "panel_state.hpp"
#include "pseudo_terminal.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

using Pause = PseudoTerminal::Pause;
const std::map<std::string, std::string> kUtf8 = {{"LANG", "C.UTF-8"}};

int count(const std::string& text, const std::string& part) {
  int n = 0;
  for (size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++n;
  return n;
}

/// The panel of run_at(update), the only state so far.
std::string panel_text(int64_t update, TerminalSize size) {
  PanelHistory history;
  history.add(run_at(update));
  std::string text;
  for (const Line& line : panel(run_at(update), history, size, {false, true})) text += line.print({false, true}) + "\n";
  return text;
}

/// A screen with this text, the cursor at the beginning of the line below.
std::string screen_of(const std::string& text) { return text + cat("cursor 0 ", count(text, "\n"), "\n"); }

class Terminal : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!has_terminal_emulator()) GTEST_SKIP() << "Python's pyte is not here; scripts/bootstrap --dev installs it";
  }
  /// A program with a logger and a panel.
  template <class F>
  auto with_panel(F use) {
    return [this, use](const Pause& pause) {
      Logger log(folder_ / "log.txt", Logger::Console::all);
      Progress progress(log, progress_mode(false));
      use(log, progress, pause);
    };
  }
  TemporaryFolder folder_;
};

TEST_F(Terminal, MessagesStandAboveThePanelThatStaysAtTheEnd) {
  const TerminalSize size{80, 30};
  PseudoTerminal terminal(size, kUtf8, with_panel([](Logger& log, Progress& progress, const Pause& pause) {
                            log.info("training");
                            progress.show(run_at(100));
                            pause();
                            log.warn("a message");
                            pause();
                            progress.finish();
                            log.info("done");
                          }));
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("training\n" + panel_text(100, size)));
  EXPECT_EQ(terminal.colors(), "0087ff 808080 default ff8700\n");
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("training\nwarning: a message\n" + panel_text(100, size)));
  EXPECT_FALSE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("training\nwarning: a message\n" + panel_text(100, size) + "done\n"));
  EXPECT_EQ(count(terminal.output(), "\x1b[?25l"), 0) << "a hidden cursor stays hidden after Ctrl-C";
}

TEST_F(Terminal, PanelStaysAtTheBottomWhileMessagesScroll) {
  PseudoTerminal terminal({80, 24}, kUtf8, with_panel([](Logger& log, Progress& progress, const Pause& pause) {
                            progress.show(run_at(100));
                            for (int k = 1; k <= 40; ++k) log.info(cat("message ", k));
                            pause();
                          }));
  ASSERT_TRUE(terminal.run());
  // 24 rows: the panel takes 21, the cursor 1.
  EXPECT_EQ(terminal.screen(), screen_of("message 39\nmessage 40\n" + panel_text(100, {80, 24})));
}

TEST_F(Terminal, FollowsTheWindowsSize) {
  for (const TerminalSize size : {TerminalSize{100, 30}, {50, 30}, {20, 30}}) {
    SCOPED_TRACE(size.columns);
    PseudoTerminal resized({80, 30}, kUtf8, with_panel([](Logger& log, Progress& progress, const Pause& pause) {
                             progress.show(run_at(100));
                             pause();
                             progress.finish();
                             log.info("end");
                             pause();
                           }));
    ASSERT_TRUE(resized.run());
    resized.resize(size);
    ASSERT_TRUE(resized.run());
    EXPECT_EQ(resized.screen(), screen_of(panel_text(100, size) + "end\n"));
  }
}

// The emulator cuts lines when it gets narrow; most terminals wrap them instead.
TEST(TerminalBytes, RowsThatWrappedAreErasedToo) {
  PseudoTerminal terminal({80, 30}, kUtf8, [](const Pause& pause) {
    LiveLines live(STDERR_FILENO);
    Line long_line, short_line;
    long_line.add(std::string(70, 'x'));
    short_line.add("short");
    live.show({long_line, short_line}, {});
    pause();
    live.show({short_line}, {});
    pause();
  });
  ASSERT_TRUE(terminal.run());
  const size_t first = terminal.output().size();
  terminal.resize({30, 30});
  ASSERT_TRUE(terminal.run());
  // 70 columns wrap into rows of 30, 30 and 10: with the short line 4 rows, up to the first and erased one by one.
  std::string expected = "\r\x1b[4A";
  for (int row = 0; row < 4; ++row) expected += "\x1b[2K\x1b[B";
  expected += "\r\x1b[4Ashort\x1b[K\r\n\x1b[J";
  EXPECT_EQ(terminal.output().substr(first), expected);
}

TEST_F(Terminal, MessageAfterTheWindowGotNarrow) {
  PseudoTerminal terminal({80, 30}, kUtf8, with_panel([](Logger& log, Progress& progress, const Pause& pause) {
                            progress.show(run_at(100));
                            pause();
                            log.info("a message");
                            pause();
                            progress.finish();
                            pause();
                          }));
  ASSERT_TRUE(terminal.run());
  terminal.resize({40, 30});
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("a message\n")) << "the panel does not fit and waits to be laid out anew";
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("a message\n" + panel_text(100, {40, 30})));
}

TEST_F(Terminal, NarrowAndLowOnes) {
  for (const TerminalSize size : {TerminalSize{59, 24}, {40, 24}, {20, 24}, {80, 10}, {5, 2}}) {
    SCOPED_TRACE(cat(size.columns, " x ", size.rows));
    PseudoTerminal terminal(size, kUtf8, with_panel([](Logger&, Progress& progress, const Pause& pause) {
                              progress.show(run_at(100));
                              pause();
                            }));
    ASSERT_TRUE(terminal.run());
    EXPECT_EQ(terminal.screen(), screen_of(panel_text(100, size)));
  }
}

TEST_F(Terminal, DrawsOnlyWhatIsNewAndNotTooOften) {
  const auto start = std::chrono::steady_clock::now();
  PseudoTerminal terminal({80, 30}, kUtf8, with_panel([](Logger&, Progress& progress, const Pause& pause) {
                            for (int k = 1; k < 200; ++k) progress.show(run_at(k));
                            pause();
                            progress.show(run_at(200));
                            pause();
                            progress.show(run_at(200));
                            progress.finish();
                            pause();
                          }));
  ASSERT_TRUE(terminal.run());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const int frames = count(terminal.output(), "elapsed");
  EXPECT_GE(frames, 1);
  EXPECT_LE(frames, 1 + static_cast<int>(seconds / 0.1)) << "in " << seconds << " s";
  ASSERT_TRUE(terminal.run());
  EXPECT_TRUE(contains(terminal.screen(), {"100%", "300 M of 300 M"})) << "the last state is drawn at once";
  const size_t written = terminal.output().size();
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.output().size(), written) << "nothing changed";
}

void show_once(Logger& log, Progress& progress, const Pause& pause) {
  progress.show(run_at(100));
  log.info("a message");
  pause();
}

TEST_F(Terminal, NoColor) {
  PseudoTerminal terminal({80, 30}, {{"LANG", "C.UTF-8"}, {"NO_COLOR", "1"}}, with_panel(show_once));
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.screen(), screen_of("a message\n" + panel_text(100, {80, 30})));
  EXPECT_EQ(terminal.colors(), "default\n");
}

TEST_F(Terminal, DumbOnesGetPlainLines) {
  PseudoTerminal terminal({80, 30}, {{"TERM", "dumb"}}, with_panel(show_once));
  ASSERT_TRUE(terminal.run());
  EXPECT_EQ(terminal.output(), progress_text(run_at(100)) + "\r\na message\r\n");
}

TEST_F(Terminal, Quiet) {
  PseudoTerminal terminal({80, 30}, kUtf8, [this](const Pause&) {
    Logger log(folder_ / "log.txt", Logger::Console::quiet);
    Progress progress(log, progress_mode(true));
    log.info("unheard");
    progress.show(run_at(100));
    log.warn("heard");
  });
  EXPECT_FALSE(terminal.run());
  EXPECT_EQ(terminal.output(), "warning: heard\r\n");
  EXPECT_TRUE(contains(read_file(folder_ / "log.txt"), {"unheard", "update 100 of 200"}));
}

}  // namespace
}  // namespace giga::test
