// The logger, by spdlog.
#include "io/logger.hpp"

#include <spdlog/logger.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <unistd.h>

#include <cstdlib>
#include <string_view>

#include "core/error.hpp"

namespace giga {

struct Logger::Loggers {
  spdlog::logger file, console;

  explicit Loggers(const std::string& path)
      : file("file", std::make_shared<spdlog::sinks::basic_file_sink_st>(path)),
        console("console", std::make_shared<spdlog::sinks::stderr_sink_st>()) {}
};

Logger::Logger(const std::filesystem::path& file, Console console) {
  try {
    loggers_ = std::make_unique<Loggers>(file.string());
  } catch (const spdlog::spdlog_ex& e) {
    throw Error(e.what());
  }
  loggers_->file.set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %l: %v");
  loggers_->file.set_error_handler([](const std::string& message) { throw Error("cannot write the log: " + message); });
  // On a terminal a message takes the line of the progress bar, which is drawn again below it.
  loggers_->console.set_pattern(stderr_is_terminal() ? "\r\x1b[K%v" : "%v");
  if (console == Console::quiet) loggers_->console.set_level(spdlog::level::warn);
  for (spdlog::logger* logger : {&loggers_->file, &loggers_->console}) logger->flush_on(spdlog::level::info);
}
Logger::~Logger() = default;

// Messages are passed as values, never as format strings: they may contain braces.
void Logger::info(const std::string& message) {
  note(message);
  loggers_->console.log(spdlog::level::info, std::string_view(message));
}
void Logger::warn(const std::string& message) {
  loggers_->file.log(spdlog::level::warn, std::string_view(message));
  loggers_->console.log(spdlog::level::warn, std::string_view("warning: " + message));
}
void Logger::error(const std::string& message) { loggers_->file.log(spdlog::level::err, std::string_view(message)); }
void Logger::note(const std::string& message) { loggers_->file.log(spdlog::level::info, std::string_view(message)); }

bool stderr_is_terminal() {
  const char* term = std::getenv("TERM");
  return ::isatty(STDERR_FILENO) == 1 && term && std::string_view(term) != "dumb";
}

}  // namespace giga
