// parse_yaml_text: events of yaml-cpp into our tree. The only file that knows yaml-cpp.
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

#include <algorithm>
#include <sstream>
#include <unordered_map>

#include "config/document.hpp"
#include "core/error.hpp"
#include "core/utf8.hpp"

namespace giga {
namespace {

/// Builds the tree of one document and reports what we do not allow.
class TreeBuilder : public YAML::EventHandler {
 public:
  TreeBuilder(std::shared_ptr<const std::string> source, Errors& errors)
      : source_(std::move(source)), errors_(errors) {}

  Node take() { return std::move(root_); }

  void OnDocumentStart(const YAML::Mark&) override {}
  void OnDocumentEnd() override {}
  void OnAnchor(const YAML::Mark& mark, const std::string& name) override {
    anchors_.push_back(name);
    errors_.add(position(mark), cat("anchors are not allowed: &", name, "; write the value where it is needed"));
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t number) override {
    const std::string name = number > 0 && number <= anchors_.size() ? anchors_[number - 1] : "";  // counted from 1
    errors_.add(position(mark), cat("aliases are not allowed: *", name, "; write the value itself"));
    if (!open_.empty()) open_.back().drop = true;
    put(node(mark, Node::Kind::null));
  }
  void OnNull(const YAML::Mark& mark, YAML::anchor_t) override { put(node(mark, Node::Kind::null)); }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t, const std::string& value) override {
    check_tag(mark, tag);
    Node scalar = node(mark, Node::Kind::scalar);
    scalar.text = value;
    scalar.quoted = tag == "!";  // yaml-cpp's mark of a scalar that is not plain
    put(std::move(scalar));
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {
    check_tag(mark, tag);
    open_.push_back({node(mark, Node::Kind::sequence)});
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t, YAML::EmitterStyle::value) override {
    check_tag(mark, tag);
    open_.push_back({node(mark, Node::Kind::map)});
  }
  void OnMapEnd() override { close(); }

 private:
  /// A sequence or map being read.
  struct Open {
    Node node;
    bool has_key = false, drop = false;  // drop: the key was wrong, so its value goes nowhere
    std::string key = {};
    Position key_at = {};
    std::unordered_map<std::string, int> lines = {};  // of the keys so far
  };

  Position position(const YAML::Mark& mark) const { return {source_, mark.line + 1, mark.column + 1}; }

  Node node(const YAML::Mark& mark, Node::Kind kind) const {
    Node result;
    result.kind = kind;
    result.at = position(mark);
    return result;
  }

  void check_tag(const YAML::Mark& mark, const std::string& tag) {
    if (tag.empty() || tag == "?" || tag == "!") return;
    errors_.add(position(mark), cat("tags are not allowed: ", tag, "; write the value alone"));
  }

  void close() {
    Node done = std::move(open_.back().node);
    open_.pop_back();
    put(std::move(done));
  }

  /// Hands a finished node to what contains it.
  void put(Node&& value) {
    if (open_.empty()) {
      root_ = std::move(value);
      return;
    }
    Open& parent = open_.back();
    if (parent.node.is_sequence()) {
      parent.node.items.push_back(std::move(value));
    } else if (!parent.has_key) {
      take_key(parent, value);
    } else {
      if (value.is_null()) value.at = parent.key_at;  // where the parser noticed is a line too late
      if (!parent.drop) parent.node.entries.push_back({parent.key, parent.key_at, std::move(value)});
      parent.has_key = false;
    }
  }

  void take_key(Open& map, const Node& key) {
    map.has_key = true;
    map.drop = !key.is_scalar();
    map.key = key.text;
    map.key_at = key.at;
    if (map.drop) return errors_.add(key.at, "a key must be a name, not " + key.shown());
    const auto [first, is_new] = map.lines.emplace(key.text, key.at.line);
    map.drop = !is_new;
    if (map.drop) errors_.add(key.at, cat("duplicate key '", key.text, "', first given at line ", first->second));
  }

  std::shared_ptr<const std::string> source_;
  Errors& errors_;
  Node root_;
  std::vector<Open> open_;
  std::vector<std::string> anchors_;  // in the order of the file
};

/// Is the text UTF-8 without control characters? Reports the first offence.
bool check_encoding(std::string_view text, const std::shared_ptr<const std::string>& source, Errors& errors) {
  Position at{source, 1, 1};
  while (!text.empty()) {
    const unsigned char c = static_cast<unsigned char>(text[0]);
    const size_t length = utf8_length(text, 0);
    if (length == 0)
      return errors.add(at, cat("not UTF-8: byte ", static_cast<int>(c), "; save the file as UTF-8")), false;
    if ((c < 0x20 && c != '\n' && c != '\r' && c != '\t') || c == 0x7f)
      return errors.add(at, cat("control character ", static_cast<int>(c), "; a file may hold text only")), false;
    ++at.column;
    if (c == '\n') ++at.line, at.column = 1;
    text.remove_prefix(length);
  }
  return true;
}

// ---- What is wrong with a text that is no YAML ----------------------------------------------------------------------

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    if (line.ends_with('\r')) line.remove_suffix(1);
    lines.push_back(line);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

/// "'  gamma 0.9'", tabs by name.
std::string shown_line(std::string_view line) {
  constexpr size_t kMost = 80;
  std::string text;
  for (const char c : line) {
    if (text.size() >= kMost) return "'" + text + "...'";
    text += c == '\t' ? "<tab>" : std::string(1, c);
  }
  return "'" + text + "'";
}

/// "; the line: '...'" where there is one.
std::string line_text(std::string_view text, int line) {
  const std::vector<std::string_view> lines = lines_of(text);
  const bool there = line >= 0 && static_cast<size_t>(line) < lines.size();
  return there ? "; the line: " + shown_line(lines[static_cast<size_t>(line)]) : "";
}

size_t indent_of(std::string_view line) { return std::min(line.find_first_not_of(' '), line.size()); }

std::string spaces(size_t n) { return counted(static_cast<int64_t>(n), "spaces"); }

bool says_nothing(std::string_view line) {
  const size_t first = line.find_first_not_of(" \t");
  return first == std::string_view::npos || line[first] == '#';
}

/// A key with its colon begins this line.
bool has_key(std::string_view line) {
  const size_t colon = line.find(':');
  return colon != std::string_view::npos && (colon + 1 == line.size() || line[colon + 1] == ' ');
}

/// What people get wrong most, by name and with its line: tabs, a key without its colon, an indentation of its own.
/// `bad` is the line, from 0, at which the parser gave up. False where it is none of these.
bool explain(std::string_view text, size_t bad, const std::shared_ptr<const std::string>& source, Errors& errors) {
  const std::vector<std::string_view> lines = lines_of(text);
  const auto add = [&](size_t line, size_t column, const std::string& message) {
    errors.add({source, static_cast<int>(line) + 1, static_cast<int>(column) + 1},
               cat(message, ": ", shown_line(lines[line])));
  };
  for (size_t k = std::min(bad + 1, lines.size()); k-- > 0;) {  // the nearest
    const size_t indent = indent_of(lines[k]);
    if (indent == lines[k].size() || lines[k][indent] != '\t' || says_nothing(lines[k])) continue;
    return add(k, indent, "a tab before the key; YAML is indented with spaces"), true;
  }
  if (bad >= lines.size()) return false;
  // The lines above that say something, nearest first; a map's keys begin in one column.
  std::vector<size_t> above;
  for (size_t k = bad; k-- > 0;)
    if (!says_nothing(lines[k])) above.push_back(k);
  if (above.empty() || !has_key(lines[bad])) return false;
  const size_t indent = indent_of(lines[bad]), before = above[0], column = indent_of(lines[before]);
  if (!has_key(lines[before]) && lines[before].find_first_of("[]{}\"'#-|>&*") == std::string_view::npos)
    return add(before, column, "a key without its colon, as in `gamma: 0.9`"), true;
  if (indent > column && !lines[before].ends_with(':'))
    return add(bad, indent,
               cat("indented by ", spaces(indent), ", the key above it by ", column,
                   ": the keys of a group begin in one column")),
           true;
  for (const size_t k : above)
    if (indent_of(lines[k]) == indent) return false;
  return add(bad, indent, cat("indented by ", spaces(indent), ", as no key above it is")), true;
}

}  // namespace

Document parse_yaml_text(std::string_view text, const std::string& name, Errors& errors) {
  const auto source = std::make_shared<const std::string>(name);
  Document document{name, {}};
  document.root.at = {source, 1, 1};
  if (!check_encoding(text, source, errors)) return document;

  std::istringstream in{std::string(text)};
  TreeBuilder builder(source, errors);
  try {
    YAML::Parser parser(in);
    if (!parser.HandleNextDocument(builder)) return document;
    document.root = builder.take();
    TreeBuilder second(source, errors);
    if (parser.HandleNextDocument(second))
      errors.add(second.take().at, "a second document starts here; a file may have one only");
  } catch (const YAML::DeepRecursion& e) {
    errors.add({source, e.mark.line + 1, e.mark.column + 1}, "nested too deeply");
    document.root = {};
    document.root.at = {source, 1, 1};
  } catch (const YAML::Exception& e) {
    const Position at{source, e.mark.line + 1, e.mark.column + 1};
    if (e.mark.is_null() || !explain(text, static_cast<size_t>(e.mark.line), source, errors))
      errors.add(e.mark.is_null() ? Position{source} : at, "not valid YAML: " + e.msg + line_text(text, e.mark.line));
    document.root = {};
    document.root.at = {source, 1, 1};
  }
  return document;
}

}  // namespace giga
