// The logger, by spdlog.
#include "io/logger.hpp"

#include <spdlog/details/null_mutex.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <unistd.h>

#include <string_view>

#include "core/error.hpp"

namespace giga {
namespace {

/// Writes messages above the lines that stay at the bottom of the terminal.
class ConsoleSink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  explicit ConsoleSink(LiveLines& live) : live_(live) {}

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t text;
    formatter_->format(message, text);
    live_.print(std::string_view(text.data(), text.size()));
  }
  void flush_() override {}

 private:
  LiveLines& live_;
};

}  // namespace

struct Logger::Loggers {
  spdlog::logger file, console;

  Loggers(const std::string& path, LiveLines& live)
      : file("file", std::make_shared<spdlog::sinks::basic_file_sink_st>(path)),
        console("console", std::make_shared<ConsoleSink>(live)) {}
};

Logger::Logger(const std::filesystem::path& file, Console console) : live_(STDERR_FILENO) {
  try {
    loggers_ = std::make_unique<Loggers>(file.string(), live_);
  } catch (const spdlog::spdlog_ex& e) {
    throw Error(e.what());
  }
  loggers_->file.set_pattern("%Y-%m-%dT%H:%M:%S.%e%z %l: %v");
  loggers_->file.set_error_handler([](const std::string& message) { throw Error("cannot write the log: " + message); });
  loggers_->console.set_pattern("%v");
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
void Logger::answer(const std::string& message) {
  note(message);
  loggers_->console.log(spdlog::level::warn, std::string_view(message));
}
void Logger::error(const std::string& message) { loggers_->file.log(spdlog::level::err, std::string_view(message)); }
void Logger::note(const std::string& message) { loggers_->file.log(spdlog::level::info, std::string_view(message)); }

}  // namespace giga
