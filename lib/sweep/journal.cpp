#include "sweep/journal.hpp"

#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "io/files.hpp"

namespace giga {
namespace fs = std::filesystem;

SweepJournal::SweepJournal(const fs::path& file) {
  std::error_code code;
  if (!fs::exists(file, code)) {
    file_.emplace(AppendFile::create(file));
    return;
  }
  const std::string text = read_file(file);
  size_t begin = 0;
  for (size_t end; (end = text.find('\n', begin)) != std::string::npos; begin = end + 1) {
    Json event = Json::parse(text.substr(begin, end - begin), nullptr, false);
    if (!event.is_object()) throw InputError(cat(file.string(), ":", events_.size() + 1, ": this line is damaged"));
    events_.push_back(std::move(event));
  }
  file_.emplace(AppendFile::resume(file, begin));
}

SweepJournal::~SweepJournal() = default;

void SweepJournal::write(const Json& event) {
  file_->append(event.dump() + "\n");
  file_->flush_to_disk();
}

}  // namespace giga
