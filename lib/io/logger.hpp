// Logger: messages to a file and to the console (stderr). It hides spdlog.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "io/terminal/live_lines.hpp"

namespace giga {

class Logger {
 public:
  enum class Console : uint8_t {
    all,    ///< all messages appear on the console too
    quiet,  ///< only warnings and errors
  };

  Logger(const std::filesystem::path& file, Console console);
  ~Logger();
  Logger(const Logger&) = delete;
  Logger& operator=(const Logger&) = delete;

  void info(const std::string& message);
  void warn(const std::string& message);
  /// An answer to what somebody did: on the console in any case.
  void answer(const std::string& message);
  /// The error that ends the program: to the file alone, since main prints it.
  void error(const std::string& message);
  /// To the file alone.
  void note(const std::string& message);

  /// The lines of the console that stay below all messages.
  LiveLines& live() { return live_; }

 private:
  struct Loggers;
  LiveLines live_;  // before the loggers, one of which writes through it
  std::unique_ptr<Loggers> loggers_;
};

}  // namespace giga
