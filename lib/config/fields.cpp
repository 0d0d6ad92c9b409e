// What is done with a field list: reading a tree into it, printing it, listing it.
#include "config/fields.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

constexpr size_t kCommentColumn = 40;  // of the comments behind the keys, where the value leaves room
constexpr size_t kLineWidth = 120;

std::string joined_path(const std::string& path, const std::string& name) {
  return path.empty() ? name : path + "." + name;
}

/// The list that a reading began with: where else a key may belong.
struct Whole {
  const FieldList& fields;
  std::string path;  ///< before its keys in messages
};

/// Paths of all keys below a list; elements of lists and tables have names of their own and are left out.
void add_paths(const FieldList& fields, const std::string& path, std::vector<std::string>& all) {
  for (const Field& field : fields.fields()) {
    const std::string own = joined_path(path, field.name);
    all.push_back(own);
    if (field.shape == FieldShape::group) add_paths(field.members, own, all);
    if (field.shape == FieldShape::tree && field.example) add_paths(field.example(), own, all);
  }
}

/// Whether there is such a key below a list of them; the entries of a table may have any name.
bool leads_to_key(const FieldList& fields, const std::string& path) {
  const size_t end = std::min(path.find('.'), path.size());
  const auto& all = fields.fields();
  const std::string name = path.substr(0, end);
  const auto field = std::find_if(all.begin(), all.end(), [&](const Field& f) { return f.name == name; });
  if (field == all.end() || end == path.size()) return field != all.end();
  const std::string rest = path.substr(end + 1);
  switch (field->shape) {
    case FieldShape::group:
      return leads_to_key(field->members, rest);
    case FieldShape::tree:
      return !field->example || leads_to_key(field->example(), rest);
    case FieldShape::table: {
      const size_t dot = rest.find('.');
      return dot == std::string::npos || leads_to_key(field->example(), rest.substr(dot + 1));
    }
    case FieldShape::value:
    case FieldShape::list:
      break;
  }
  return false;
}

std::string last_part(const std::string& path) { return path.substr(path.rfind('.') + 1); }

/// Where a key belongs that stands in the wrong group: paths whose last name it is, or, where nothing is near it in its
/// own group, is like.
std::vector<std::string> places_of(const std::string& key, const Whole& whole, bool also_alike) {
  std::vector<std::string> paths, names, found;
  add_paths(whole.fields, whole.path, paths);
  for (const std::string& path : paths) {
    names.push_back(last_part(path));
    if (names.back() == key) found.push_back(path);
  }
  if (!found.empty() || !also_alike || key.size() < 2) return found;
  const std::vector<std::string> near = nearest_names(key, names, 1);
  constexpr int kAlike = 2;
  for (const std::string& path : paths)
    if (!near.empty() && last_part(path) == near[0] && name_distance(key, near[0]) <= kAlike) found.push_back(path);
  return found;
}

/// "; did you mean 'train.n_worlds'?" for a key that belongs elsewhere, with what was written below it where that is
/// there too; else the nearest name of its own group.
std::string hint_for(const Node::Entry& entry, const std::string& key_path, const std::vector<std::string>& names,
                     const Whole& whole) {
  constexpr size_t kMost = 3;
  const std::string nearest = nearest_hint(entry.key, names);
  std::string below;
  for (const Node* node = &entry.value; node->is_map() && node->entries.size() == 1; node = &node->entries[0].value)
    below += "." + node->entries[0].key;
  std::vector<std::string> places = places_of(entry.key, whole, nearest.empty());
  std::erase(places, key_path);
  const auto is_key = [&whole](const std::string& path) {
    return leads_to_key(whole.fields, whole.path.empty() ? path : path.substr(whole.path.size() + 1));
  };
  // A name that is only alike is not meant where what was written below it is unknown there.
  std::erase_if(places,
                [&](const std::string& place) { return last_part(place) != entry.key && !is_key(place + below); });
  if (places.empty()) return nearest;
  if (places.size() > kMost) places.resize(kMost);
  for (std::string& place : places) place = "'" + place + (is_key(place + below) ? below : "") + "'";
  return "; did you mean " + join(places, " or ") + "?";
}

/// A map, or an error that names the keys.
bool expect_map(const Node& node, const FieldList& fields, const std::string& path, Errors& errors) {
  if (node.is_map()) return true;
  std::vector<std::string> names;
  for (const Field& field : fields.fields()) names.push_back(field.name);
  const std::string what = path.empty() ? "" : path + ": ";
  const std::string found = node.is_null() ? "is empty" : "is " + node.shown();
  errors.add(node.at, cat(what, found, ", expected a map with keys out of: ", join(names)));
  return false;
}

void read_in(const Node& node, const FieldList& fields, Errors& errors, KeyPositions* given, const std::string& path,
             const Whole& whole);

void read_field(const Node& node, const Field& field, Errors& errors, KeyPositions* given, const std::string& path,
                const Whole& whole) {
  switch (field.shape) {
    case FieldShape::value:
      field.read(node, {path, errors});
      for (size_t k = 0; given && k < node.items.size(); ++k) (*given)[cat(path, "[", k, "]")] = node.items[k].at;
      return;
    case FieldShape::group:
      return read_in(node, field.members, errors, given, path, whole);
    case FieldShape::list:
      if (!node.is_sequence()) return errors.add(node.at, cat(path, ": ", node.shown(), " is not ", field.expected));
      field.clear();
      for (size_t k = 0; k < node.items.size() && !errors.full(); ++k) {
        const std::string element = cat(path, "[", k, "]");
        if (given) (*given)[element] = node.items[k].at;
        read_in(node.items[k], field.add(""), errors, given, element, whole);
      }
      return;
    case FieldShape::table:
      if (!node.is_map()) return errors.add(node.at, cat(path, ": ", node.shown(), " is not ", field.expected));
      for (const Node::Entry& entry : node.entries) {
        const std::string element = joined_path(path, entry.key);
        if (given) (*given)[element] = entry.at;
        read_in(entry.value, field.add(entry.key), errors, given, element, whole);
      }
      return;
    case FieldShape::tree:
      if (!node.is_map()) return errors.add(node.at, cat(path, ": ", node.shown(), " is not ", field.expected));
      field.assign(node);
      return;
  }
}

void read_in(const Node& node, const FieldList& fields, Errors& errors, KeyPositions* given, const std::string& path,
             const Whole& whole) {
  if (!expect_map(node, fields, path, errors)) return;
  for (const Node::Entry& entry : node.entries) {
    if (errors.full()) return;
    const std::string key_path = joined_path(path, entry.key);
    const auto& all = fields.fields();
    const auto field = std::find_if(all.begin(), all.end(), [&](const Field& f) { return f.name == entry.key; });
    if (field == all.end()) {
      if (const auto now = fields.renamed().find(entry.key); now != fields.renamed().end()) {
        errors.add(entry.at, cat(key_path, ": this key is now called '", now->second, "'"));
        if (given) given->emplace(joined_path(path, now->second), entry.at);
        continue;
      }
      if (const auto gone = fields.removed().find(entry.key); gone != fields.removed().end()) {
        const auto& [instead, idle] = gone->second;
        const bool is_idle = !idle.empty() && entry.value.is_scalar() && entry.value.text == idle;
        if (!is_idle) errors.add(entry.at, cat(key_path, ": there is no such key any more: ", instead));
        continue;
      }
      std::vector<std::string> names;
      for (const Field& known : all) names.push_back(known.name);
      const std::string hint = hint_for(entry, key_path, names, whole);
      errors.add(entry.at, cat(key_path, ": unknown key", hint,
                               hint.ends_with('?') ? " Allowed here: " : "; allowed: ", join(names)));
      for (const std::string& meant : nearest_names(entry.key, names, 1))
        if (given) given->emplace(joined_path(path, meant), entry.at);
      continue;
    }
    if (given) (*given)[key_path] = entry.value.at;
    read_field(entry.value, *field, errors, given, key_path, whole);
  }
}

/// What a value may be, behind its default; nothing where the default already tells.
std::string limits_of(const Field& field) {
  for (const char* obvious : {"", "a text", "true or false", "a number", "an integer"})
    if (field.expected == obvious) return "";
  return "; " + field.expected;
}

/// All fields of a list on one line: `{type: default, count: 5}`.
std::string print_flow(const FieldList& fields) {
  std::string text;
  for (const Field& field : fields.fields()) {
    std::string value;
    switch (field.shape) {
      case FieldShape::value:
      case FieldShape::tree:
        value = field.print();
        break;
      case FieldShape::group:
        value = print_flow(field.members);
        break;
      case FieldShape::list:
        for (const auto& element : field.elements()) value += (value.empty() ? "" : ", ") + print_flow(element.second);
        value = "[" + value + "]";
        break;
      case FieldShape::table:
        for (const auto& [name, element] : field.elements())
          value += (value.empty() ? "" : ", ") + print_text(name) + ": " + print_flow(element);
        value = "{" + value + "}";
        break;
    }
    text += (text.empty() ? "" : ", ") + field.name + ": " + value;
  }
  return "{" + text + "}";
}

/// Writes the block form with comments.
class Printer {
 public:
  explicit Printer(bool with_comments) : with_comments_(with_comments) {}
  std::string take() { return std::move(text_); }

  void block(const FieldList& fields, const FieldList& defaults, size_t indent) {
    for (size_t k = 0; k < fields.fields().size(); ++k) {
      const Field& field = fields.fields()[k];
      const Field& standard = defaults.fields()[k];  // same struct, same order
      const std::string start = std::string(indent, ' ') + field.name + ":";
      switch (field.shape) {
        case FieldShape::value:
        case FieldShape::tree: {
          line(start + " " + field.print(), field.doc + " (default " + standard.print() + limits_of(field) + ")");
          break;
        }
        case FieldShape::group:
          if (with_comments_ && indent == 0) text_ += "\n";
          line(field.members.fields().empty() ? start + " {}" : start, field.doc);
          block(field.members, standard.members, indent + 2);
          break;
        case FieldShape::list:
        case FieldShape::table:
          elements(field, start, indent);
          break;
      }
    }
  }

 private:
  void elements(const Field& field, const std::string& start, size_t indent) {
    const auto all = field.elements();
    const bool is_list = field.shape == FieldShape::list;
    if (with_comments_ && indent == 0 && !is_list) text_ += "\n";
    line(all.empty() ? start + (is_list ? " []" : " {}") : start, field.doc);
    const FieldList example = field.example();
    for (const auto& [name, element] : all) {
      if (is_list) {
        text_ += std::string(indent + 2, ' ') + "- " + print_flow(element) + "\n";
      } else {
        text_ += std::string(indent + 2, ' ') + print_text(name) + ":\n";
        Printer inner(false);  // the keys of every entry are the same: no need to repeat their documentation
        inner.block(element, example, indent + 4);
        text_ += inner.take();
      }
    }
  }

  /// One key with its comment: behind it if there is room, else above.
  void line(const std::string& code, const std::string& comment) {
    if (!with_comments_ || comment.empty()) {
      text_ += code + "\n";
      return;
    }
    const size_t column = std::max(kCommentColumn, code.size() + 2);
    if (column + 2 + comment.size() <= kLineWidth) {
      text_ += code + std::string(column - code.size(), ' ') + "# " + comment + "\n";
    } else {
      const size_t indent = code.find_first_not_of(' ');
      text_ += std::string(indent, ' ') + "# " + comment + "\n" + code + "\n";
    }
  }

  bool with_comments_;
  std::string text_;
};

void list_into(const FieldList& fields, const std::string& path, std::vector<FieldInfo>& all) {
  for (const Field& field : fields.fields()) {
    FieldInfo info{joined_path(path, field.name), field.type, "", field.expected, field.doc, field.shape};
    if (field.print) info.default_value = field.print();
    all.push_back(info);
    if (field.shape == FieldShape::group) list_into(field.members, info.path, all);
    if (field.shape == FieldShape::list) list_into(field.example(), info.path + "[]", all);
    if (field.shape == FieldShape::table) list_into(field.example(), info.path + ".<name>", all);
  }
}

}  // namespace

Field& FieldList::add(FieldShape shape, const std::string& name, const std::string& doc) {
  static constexpr const char* kTypes[] = {"", "group", "list of groups", "named groups", "map"};
  static constexpr const char* kExpected[] = {"", "", "a list of groups, [{key: value, ...}, ...]",
                                              "a map of groups, {name: {key: value, ...}, ...}", "a map"};
  Field& field = fields_.emplace_back();
  field.name = name;
  field.doc = doc;
  field.shape = shape;
  field.type = kTypes[static_cast<size_t>(shape)];
  field.expected = kExpected[static_cast<size_t>(shape)];
  return field;
}

void FieldList::tree(const std::string& name, Node& value, const std::string& doc, std::function<FieldList()> keys) {
  Field& field = add(FieldShape::tree, name, doc);
  field.print = [&value] { return value.is_null() ? "{}" : print_node(value); };
  field.assign = [&value](const Node& node) { value = node; };
  field.example = std::move(keys);
}

void read_fields(const Node& node, const FieldList& fields, Errors& errors, KeyPositions* given,
                 const std::string& path) {
  read_in(node, fields, errors, given, path, {fields, path});
}

bool read_config_file(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                      const FieldList& fields, Errors& errors, KeyPositions* given) {
  const size_t errors_before = errors.size();
  Document document = parse_yaml_file(file, errors);
  return read_config_document(std::move(document), errors.size() > errors_before, overrides, fields, errors, given);
}

bool read_config_document(Document document, bool has_errors, const std::vector<std::string>& overrides,
                          const FieldList& fields, Errors& errors, KeyPositions* given) {
  const bool usable = document.root.is_map();
  if (!usable && !has_errors) read_fields(document.root, fields, errors);  // says what it is instead
  // The assignments are looked at in any case, on top of nothing where there is no file.
  if (!usable) document.root = {};
  for (const std::string& assignment : overrides) set_override(document, assignment, errors);
  if (!document.root.is_null()) read_fields(document.root, fields, errors, given);
  return usable;
}

bool is_wrong(const std::string& key, const KeyPositions& given, const Errors& errors) {
  const auto contains = [](const std::string& outer, const std::string& inner) {
    return inner.starts_with(outer) &&
           (inner.size() == outer.size() || inner[outer.size()] == '.' || inner[outer.size()] == '[');
  };
  for (const auto& [other, at] : given)
    if ((contains(key, other) || contains(other, key)) && errors.has(at)) return true;
  return false;
}

std::string print_yaml(const FieldList& fields, const FieldList& defaults, bool with_comments) {
  Printer printer(with_comments);
  printer.block(fields, defaults, 0);
  return printer.take();
}

std::vector<FieldInfo> list_fields(const FieldList& defaults) {
  std::vector<FieldInfo> all;
  list_into(defaults, "", all);
  return all;
}

}  // namespace giga
