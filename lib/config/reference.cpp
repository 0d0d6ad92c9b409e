// Markdown from field lists.
#include "config/reference.hpp"

#include <array>

#include "config/names.hpp"

namespace giga {
namespace {

/// A text in a cell of a table.
std::string cell(const std::string& text) {
  std::string escaped;
  for (const char c : text) escaped += c == '|' ? "\\|" : c == '<' ? "&lt;" : std::string(1, c);
  return escaped;
}

std::string code(const std::string& text) { return text.empty() ? "" : "`" + text + "`"; }

/// What is allowed, without what the type already says: ">= 1 or none", "1 to 4 items, each in [0, 1]".
std::string allowed_text(const Field& field) {
  static constexpr std::array<const char*, 5> kOfType = {"an integer", "a number", "a text", "true or false",
                                                         "one of: "};
  std::string text = field.expected;
  for (const char* words : kOfType)
    for (size_t at; (at = text.find(words)) != std::string::npos;) text.erase(at, std::string(words).size());
  // What is left of "a list of 2 items, each a number" and of "a text or none".
  if (text.starts_with("a list of ")) text.erase(0, 10);
  if (text.starts_with("a list, each")) text.erase(0, 12);
  if (text.ends_with(", each ")) text.erase(text.size() - 7);
  for (size_t at; (at = text.find(" in [")) != std::string::npos;) text.erase(at, 3);
  while (text.starts_with(' ')) text.erase(0, 1);
  for (size_t at; (at = text.find("  ")) != std::string::npos;) text.erase(at, 1);
  return text.starts_with("or none") ? "" : text;
}

/// Name of a section: the path of its keys.
std::string section_path(const std::string& path, const Field& field) {
  std::string result = path.empty() ? field.name : path + "." + field.name;
  if (field.shape == FieldShape::list) result += "[]";
  if (field.shape == FieldShape::table) result += ".NAME";
  return result;
}

/// The members of a group, of an element of a list or of a table.
FieldList members_of(const Field& field) { return field.shape == FieldShape::group ? field.members : field.example(); }

class Page {
 public:
  Page(std::string heading, std::string see) : heading_(std::move(heading)), see_(std::move(see)) {}
  std::string take() { return std::move(text_); }

  void tables(const FieldList& fields, const std::string& path) {
    text_ += "| key | type | default | allowed | meaning |\n|---|---|---|---|---|\n";
    for (const Field& field : fields.fields()) row(field);
    for (const Field& field : fields.fields()) {
      if (field.shape == FieldShape::value || field.shape == FieldShape::tree) continue;
      const std::string section = section_path(path, field);
      text_ += "\n" + heading_ + " `" + section + "`\n\n" + capitalised(field.doc) + ".\n\n";
      tables(members_of(field), section);
    }
  }

 private:
  void row(const Field& field) {
    const bool elsewhere = field.shape != FieldShape::value;
    const std::string fallback = field.print ? code(field.print()) : "";
    const std::string allowed = field.shape == FieldShape::tree ? see_ : elsewhere ? "" : allowed_text(field);
    text_ += "| " + code(field.name) + " | " + field.type + " | " + fallback + " | " + cell(allowed) + " | " +
             cell(field.doc) + " |\n";
  }

  std::string heading_, see_, text_;
};

}  // namespace

std::string reference_tables(const FieldList& defaults, const std::string& heading, const std::string& see) {
  Page page(heading, see);
  page.tables(defaults, "");
  return page.take();
}

}  // namespace giga
