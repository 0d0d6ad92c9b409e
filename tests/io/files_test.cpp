// write_file: a whole new file or the old one, whatever goes wrong on the way.
#include "io/files.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>

#include "core/error.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

/// Files may not grow beyond a size while this lives: what a full disk is to a program.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : old_handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &old_limit_);
    const rlimit limit{bytes, old_limit_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &old_limit_);
    std::signal(SIGXFSZ, old_handler_);
  }

 private:
  rlimit old_limit_{};
  void (*old_handler_)(int);
};

TEST(Files, WriteThenRead) {
  const TemporaryFolder folder;
  const std::string bytes("a\0b\n", 4);
  write_file(folder / "f", bytes);
  EXPECT_EQ(read_file(folder / "f"), bytes);
  write_file(folder / "f", "new");
  EXPECT_EQ(read_file(folder / "f"), "new");
  EXPECT_EQ(folder.entries(), 1);
}

TEST(Files, AFullDiskLeavesTheOldFile) {
  const TemporaryFolder folder;
  write_file(folder / "f", "old");
  {
    const FileSizeLimit limit(1000);
    EXPECT_THROW(write_file(folder / "f", std::string(5000, 'x')), Error);
  }
  EXPECT_EQ(read_file(folder / "f"), "old");
  EXPECT_EQ(folder.entries(), 1) << "a part of the new file was left";
}

TEST(Files, AFolderThatIsNotThere) {
  const TemporaryFolder folder;
  try {
    write_file(folder / "none" / "f", "x");
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("No such file or directory"), std::string::npos) << e.what();
  }
  EXPECT_EQ(folder.entries(), 0);
}

TEST(Files, WhatIsNoRegularFileIsWrittenInPlace) {
  write_file("/dev/null", "x");
  EXPECT_FALSE(std::filesystem::is_regular_file("/dev/null"));
}

TEST(Files, ALinkStaysALink) {
  const TemporaryFolder folder;
  write_file(folder / "there", "old");
  std::filesystem::create_symlink("there", folder / "link");
  write_file(folder / "link", "new");
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "link"));
  EXPECT_EQ(read_file(folder / "there"), "new");

  std::filesystem::create_symlink("nowhere", folder / "dangling");
  write_file(folder / "dangling", "a file now");
  EXPECT_FALSE(std::filesystem::is_symlink(folder / "dangling"));
  EXPECT_EQ(read_file(folder / "dangling"), "a file now");
}

TEST(Files, LeftoversOfInterruptedWritesAreRemoved) {
  const TemporaryFolder folder;
  std::ofstream(folder / "update_00000001.h5.999999999.tmp") << "half";  // no system has so many processes
  write_file(folder / "update_00000002.h5", "whole");
  write_file(folder / "notes.tmp", "somebody's own");
  EXPECT_EQ(remove_temporaries(folder.path()), 1);
  EXPECT_EQ(folder.entries(), 2);
  EXPECT_EQ(read_file(folder / "notes.tmp"), "somebody's own");
  EXPECT_EQ(read_file(folder / "update_00000002.h5"), "whole");
}

TEST(Files, WhatAnotherProcessIsWritingStays) {
  const pid_t writer = ::fork();
  ASSERT_GE(writer, 0);
  if (writer == 0) {
    ::pause();
    std::_Exit(0);
  }
  const TemporaryFolder folder;
  const std::filesystem::path file = folder / cat("report.html.", writer, ".tmp");
  std::ofstream(file) << "half";
  EXPECT_EQ(remove_temporaries(folder.path()), 0);
  // Two hours later the number is another process's.
  std::filesystem::last_write_time(file, std::filesystem::last_write_time(file) - std::chrono::hours(2));
  EXPECT_EQ(remove_temporaries(folder.path()), 1);
  ::kill(writer, SIGKILL);
  ::waitpid(writer, nullptr, 0);
}

}  // namespace
}  // namespace giga::test
