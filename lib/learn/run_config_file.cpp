#include "learn/run_config_file.hpp"

#include <algorithm>
#include <system_error>
#include <utility>
#include <vector>

#include "config/names.hpp"
#include "core/error.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char* kConfigFolder = "configs";

/// What `over` says takes the place of what stands there; of two maps, key by key.
void put_over(Node& under, Node over) {
  if (!under.is_map() || !over.is_map()) {
    under = std::move(over);
    return;
  }
  for (Node::Entry& entry : over.entries) {
    const auto same = [&](const Node::Entry& other) { return other.key == entry.key; };
    const auto found = std::find_if(under.entries.begin(), under.entries.end(), same);
    if (found == under.entries.end()) {
      under.entries.push_back(std::move(entry));
    } else {
      found->at = entry.at;
      put_over(found->value, std::move(entry.value));
    }
  }
  under.at = over.at;
}

class Reader {
 public:
  Reader(const DataDirs& dirs, Errors& errors) : dirs_(dirs), errors_(errors) {}

  Document read(const fs::path& file) {
    std::error_code code;
    open_.push_back(fs::weakly_canonical(file, code));
    Document document = parse_yaml_file(file, errors_);
    const Node* base = document.root.find("base");
    if (base && base->is_scalar()) {  // else it is an error of the file's keys
      Node whole = is_none(*base) ? Node{} : read_base(*base, file);
      std::erase_if(document.root.entries, [](const Node::Entry& entry) { return entry.key == "base"; });
      if (whole.is_map()) {
        put_over(whole, std::move(document.root));
        document.root = std::move(whole);
      }
    }
    open_.pop_back();
    return document;
  }

 private:
  Node read_base(const Node& base, const fs::path& from) {
    const std::optional<fs::path> file = find(base.text, from.parent_path());
    std::error_code code;
    if (!file) {
      const std::vector<std::string> known = data_names(dirs_, kConfigFolder);
      errors_.add(base.at, cat("base: there is no config '", base.text, "'", nearest_hint(base.text, known),
                               "; allowed: ", join(known), ", or a path from this file's folder"));
      return {};
    }
    if (std::find(open_.begin(), open_.end(), fs::weakly_canonical(*file, code)) != open_.end()) {
      errors_.add(base.at, cat("base: '", base.text, "' leads back to this file"));
      return {};
    }
    return read(*file).root;
  }

  std::optional<fs::path> find(const std::string& text, const fs::path& folder) const {
    const fs::path asked = text;
    if (!asked.has_parent_path() && asked.extension() != ".yaml")
      return find_data_file(dirs_, fs::path(kConfigFolder) / (text + ".yaml"));
    std::error_code code;
    const fs::path file = (folder / asked).lexically_normal();
    return fs::is_regular_file(file, code) ? std::optional(file) : std::nullopt;
  }

  const DataDirs& dirs_;
  Errors& errors_;
  std::vector<fs::path> open_;  // the chain of bases
};

}  // namespace

Document read_run_config_file(const fs::path& file, const DataDirs& dirs, Errors& errors) {
  return Reader(dirs, errors).read(file);
}

}  // namespace giga
