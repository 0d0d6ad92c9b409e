// Error: the exception type of gigastep, what is derived from it, and GIGA_CHECK, which throws it with the values in
// the message.
#pragma once

#include <cstdint>
#include <sstream>
#include <stdexcept>
#include <string>

namespace giga {

/// What went wrong, which decides the exit code of the program (`main` maps it).
enum class ErrorKind {
  input,     ///< the user's file, flag or value is wrong: exit code 2
  diverged,  ///< training produced a NaN or an infinity: exit code 3
  internal,  ///< anything else: exit code 1
};

class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message, ErrorKind kind = ErrorKind::internal)
      : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

/// An error that the user can mend: a wrong file, flag or value.
class InputError : public Error {
 public:
  explicit InputError(const std::string& message) : Error(message, ErrorKind::input) {}
};

/// A device refused a call, or work that was queued before failed on it.
class DeviceError : public Error {
 public:
  explicit DeviceError(const std::string& message) : Error(message) {}
};

/// Streams all arguments into one string: cat("n = ", 3) == "n = 3".
template <class... Args>
std::string cat(const Args&... args) {
  std::ostringstream out;
  (out << ... << args);
  return out.str();
}

/// "1 update", "2 updates": `things` is a plural with an s.
inline std::string counted(int64_t n, const std::string& things) {
  return cat(n, ' ', n == 1 ? things.substr(0, things.size() - 1) : things);
}

/// "3 seeds"; "3 runs of 2 seeds" where runs share one: they tell less than as many seeds would.
inline std::string counted_seeds(size_t runs, size_t seeds) {
  const std::string text = counted(static_cast<int64_t>(seeds), "seeds");
  return runs == seeds ? text : cat(counted(static_cast<int64_t>(runs), "runs"), " of ", text);
}

}  // namespace giga

/// Throws giga::Error with file, line, the condition and the streamed arguments unless `condition` holds.
#define GIGA_CHECK(condition, ...)                                                                                \
  do {                                                                                                            \
    if (!(condition))                                                                                             \
      throw ::giga::Error(::giga::cat(__FILE__, ":", __LINE__, ": check failed: " #condition ": ", __VA_ARGS__)); \
  } while (false)
