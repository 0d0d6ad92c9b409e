// SweepJournal: what happened in a sweep, an event a line as JSON. It is all that a sweep must remember: trials follow
// from the spec, what they learned lies in their run folders.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "io/append_file.hpp"
#include "io/json.hpp"

namespace giga {

class SweepJournal {
 public:
  /// Opens the journal of a sweep, or begins one. A last line that is not whole was never answered for: it is cut off.
  /// Throws InputError where another line is damaged.
  explicit SweepJournal(const std::filesystem::path& file);
  ~SweepJournal();
  SweepJournal(const SweepJournal&) = delete;
  SweepJournal& operator=(const SweepJournal&) = delete;

  /// Of earlier calls.
  const std::vector<Json>& events() const { return events_; }
  /// It is on the disk when this returns.
  void write(const Json& event);

 private:
  std::vector<Json> events_;
  std::optional<AppendFile> file_;
};

}  // namespace giga
