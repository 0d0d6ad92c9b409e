// Running the built gigastep as a user does, and looking at what it gives.
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "config/document.hpp"

namespace giga::test {

struct Outcome {
  int code = -1;
  std::string out, err;
};

/// The built program.
extern const std::string kGigastep;
/// The library that makes file operations of a process fail (fault/fault.c), under a name for LD_PRELOAD, which ends a
/// name at a space.
std::string fault_library();

/// Settings of the environment of one process: {"NAME", "value"}.
using Environment = std::vector<std::pair<std::string, std::string>>;

/// A gigastep that runs beside the test; killed and waited for at the end.
class Process {
 public:
  Process(const std::filesystem::path& folder, const std::vector<std::string>& arguments, const std::string& program,
          const std::filesystem::path& out, const std::filesystem::path& err, const Environment& environment);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  int pid() const { return pid_; }
  void send(int signal) const;
  /// Waits for the end. The code is that of a shell: 128 + the signal where one ended the process.
  Outcome wait();

 private:
  int pid_;
  std::filesystem::path out_, err_;
};

/// A folder of its own with the program run in it; removed at the end.
class Workplace {
 public:
  Workplace();
  ~Workplace();
  Workplace(const Workplace&) = delete;
  Workplace& operator=(const Workplace&) = delete;

  /// `gigastep arguments...` in the folder. A program without a slash is looked for in PATH, as a shell does.
  Outcome run(const std::vector<std::string>& arguments, const std::string& program = kGigastep,
              const Environment& environment = {}) const;
  /// The same without waiting; one at a time.
  std::unique_ptr<Process> start(const std::vector<std::string>& arguments, const std::string& program = kGigastep,
                                 const Environment& environment = {}) const;

  const std::filesystem::path& path() const { return path_; }
  void write(const std::string& name, const std::string& text) const;
  std::string read(const std::string& name) const;
  bool has(const std::string& name) const { return std::filesystem::exists(path_ / name); }
  /// Names directly in the folder.
  std::vector<std::string> entries() const;

 private:
  std::filesystem::path path_;
  std::filesystem::path streams_;  // stdout and stderr of the program
};

/// Whether a text has all the parts; shows it where not.
::testing::AssertionResult contains(const std::string& text, std::initializer_list<std::string> parts);

/// A value in JSON (which is YAML) by its path, as {"sides", "0", "wins"}; fails the test where there is none.
const Node& at(const Document& json, std::initializer_list<std::string> path);
double number_at(const Document& json, std::initializer_list<std::string> path);

/// Waits until `condition()`; fails the test after a minute.
template <class F>
::testing::AssertionResult wait_until(F&& condition) {
  for (int k = 0; k < 6000; ++k) {
    if (condition()) return ::testing::AssertionSuccess();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return ::testing::AssertionFailure() << "nothing happened for a minute";
}

/// The columns of a CSV file without quotes: name and one text per row.
struct CsvTable {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;
  /// Fails the test where there is no such column.
  const std::string& cell(size_t row, const std::string& column) const;
};
CsvTable parse_csv(const std::string& text);

/// A run of a second: 3 updates of 64 worlds, 2 against 2.
extern const char* const kTinyConfig;

}  // namespace giga::test
