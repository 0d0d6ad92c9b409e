// parse_yaml_text: events of yaml-cpp into our tree. The only file that knows yaml-cpp.
#include <yaml-cpp/depthguard.h>
#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/exceptions.h>
#include <yaml-cpp/parser.h>

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
    errors.add(e.mark.is_null() ? Position{source} : at, "not valid YAML: " + e.msg);
    document.root = {};
    document.root.at = {source, 1, 1};
  }
  return document;
}

}  // namespace giga
