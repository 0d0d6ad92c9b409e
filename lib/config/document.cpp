// Document without the YAML parser: positions, errors, look-up, overrides, printing of trees.
#include "config/document.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <map>
#include <system_error>
#include <tuple>

#include "core/error.hpp"

namespace giga {
namespace {

constexpr size_t kMaxFileBytes = size_t{4} << 20;
constexpr size_t kShownLength = 60;  // longer values are cut in messages
constexpr size_t kMostShown = 100;   // errors of one go
constexpr size_t kMostKept = 1000;
constexpr size_t kShownPath = 100;
constexpr size_t kDeepestPath = 64;  // of an assignment; no key lies that deep

/// The whole file, or an error.
bool read_file(const std::filesystem::path& path, std::string& text, Errors& errors) {
  const Position at{std::make_shared<const std::string>(path.string())};
  std::error_code code;
  const std::filesystem::file_status status = std::filesystem::status(path, code);
  if (!std::filesystem::exists(status)) return errors.add(at, "no such file"), false;
  if (std::filesystem::is_directory(status)) return errors.add(at, "is a folder, not a file"), false;
  std::ifstream in(path, std::ios::binary);
  if (!in) return errors.add(at, "cannot be opened"), false;
  std::array<char, 16384> block;
  while (in && text.size() <= kMaxFileBytes) {
    in.read(block.data(), block.size());
    text.append(block.data(), static_cast<size_t>(in.gcount()));
  }
  if (in.bad()) return errors.add(at, "cannot be read"), false;
  if (text.size() > kMaxFileBytes) return errors.add(at, "is longer than 4 MiB"), false;
  return true;
}

/// "FILE:1:2: key: message". Where the place is itself told by the key ("--set key"), the key is told once.
std::string line_of(const Position& at, const std::string& message) {
  if (!at.source) return message;
  const std::string place = at.text(), key = message.substr(0, message.find(": "));
  const bool told = at.line == 0 && place.ends_with(" " + key);
  return place + (told ? message.substr(key.size()) : ": " + message);
}

}  // namespace

std::string Position::text() const {
  const std::string name = source ? *source : "(unknown)";
  return line == 0 ? name : cat(name, ":", line, ":", column);
}

void Errors::add(const Position& at, const std::string& message) { list_.push_back({at, message}); }

void Errors::add_all(const Errors& others) { list_.insert(list_.end(), others.list_.begin(), others.list_.end()); }

void Errors::add_all(const Errors& others, const Position& at) {
  for (const Entry& entry : others.list_) add(at, entry.message);
}

bool Errors::full() const { return list_.size() >= kMostKept; }

bool Errors::has(const Position& at) const {
  return std::any_of(list_.begin(), list_.end(), [&at](const Entry& entry) {
    const Position& other = entry.at;
    return at.source && other.source && at.line == other.line && at.column == other.column &&
           *at.source == *other.source;
  });
}

std::string Errors::text() const {
  // Files in the order in which they first appear; inside a file by position.
  std::map<std::string, size_t> file_rank;
  std::vector<std::tuple<size_t, int, int, size_t>> order;
  for (size_t k = 0; k < list_.size(); ++k) {
    const Position& at = list_[k].at;
    const size_t rank = file_rank.emplace(at.source ? *at.source : "", file_rank.size()).first->second;
    order.emplace_back(rank, at.line, at.column, k);
  }
  std::sort(order.begin(), order.end());
  std::string text, last;
  size_t n_lines = 0;
  for (const auto& [rank, line, column, k] : order) {
    const std::string next = line_of(list_[k].at, list_[k].message);
    if (next == last) continue;
    if (++n_lines <= kMostShown) text += (text.empty() ? "" : "\n") + next;
    last = next;
  }
  return n_lines <= kMostShown ? text : text + cat("\n... and ", n_lines - kMostShown, " more");
}

void Errors::throw_if_any() const {
  if (!empty()) throw InputError(text());
}

const Node* Node::find(std::string_view key) const {
  for (const Entry& entry : entries)
    if (entry.key == key) return &entry.value;
  return nullptr;
}

std::string Node::shown() const {
  switch (kind) {
    case Kind::null:
      return "nothing";
    case Kind::sequence:
      return "a list";
    case Kind::map:
      return "a map";
    case Kind::scalar:
      break;
  }
  size_t length = text.size() > kShownLength ? kShownLength : text.size();
  while (length < text.size() && (static_cast<unsigned char>(text[length]) & 0xC0) == 0x80) --length;  // whole letters
  const std::string cut = text.substr(0, length) + (length < text.size() ? "..." : "");
  std::string clean;  // on one line, whatever is in it
  for (const char c : cut) clean += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  return quoted ? "'\"" + clean + "\"'" : "'" + clean + "'";
}

Document parse_yaml_file(const std::filesystem::path& path, Errors& errors) {
  std::string text;
  if (!read_file(path, text, errors)) return {path.string(), {}};
  return parse_yaml_text(text, path.string(), errors);
}

Document parse_yaml_file(const std::filesystem::path& path) {
  Errors errors;
  Document document = parse_yaml_file(path, errors);
  errors.throw_if_any();
  return document;
}

Document parse_yaml_text(std::string_view text, const std::string& name) {
  Errors errors;
  Document document = parse_yaml_text(text, name, errors);
  errors.throw_if_any();
  return document;
}

void set_override(Document& document, std::string_view assignment, Errors& errors) {
  const size_t equals = assignment.find('=');
  const std::string path(assignment.substr(0, equals));
  const std::string shown = path.size() > kShownPath ? path.substr(0, kShownPath) + "..." : path;
  const auto source = std::make_shared<const std::string>("--set " + shown);
  const Position at{source};
  if (equals == std::string_view::npos || equals == 0) {
    const size_t colon = assignment.find(':');
    const std::string hint = colon == std::string_view::npos || equals == 0
                                 ? ""
                                 : cat("; write --set ", path.substr(0, colon), "=", assignment.substr(colon + 1));
    return errors.add({std::make_shared<const std::string>(cat("--set ", assignment))}, "expected KEY=VALUE" + hint);
  }

  // The value. Its positions inside the argument say nothing that the key does not.
  Errors in_value;
  Node value = parse_yaml_text(assignment.substr(equals + 1), *source, in_value).root;
  if (!in_value.empty()) return errors.add_all(in_value, at);
  const auto relocate = [&at](auto& self, Node& node) -> void {
    node.at = at;
    for (Node& item : node.items) self(self, item);
    for (Node::Entry& entry : node.entries) entry.at = at, self(self, entry.value);
  };
  relocate(relocate, value);

  // Walk to the place, making maps on the way.
  Node* node = &document.root;
  size_t depth = 0;
  for (size_t begin = 0; begin <= path.size();) {
    const size_t end = std::min(path.find('.', begin), path.size());
    const std::string key = path.substr(begin, end - begin);
    if (key.empty()) return errors.add(at, "a key is missing between the dots");
    if (++depth > kDeepestPath) return errors.add(at, "nested too deeply");
    if (node->is_null()) {
      node->kind = Node::Kind::map;
      if (!node->at.source) node->at = at;
    }
    if (!node->is_map()) {
      const std::string parent = begin == 0 ? "the document" : path.substr(0, begin - 1);
      return errors.add(at, cat(parent, " has no keys: it is ", node->shown(), " (", node->at.text(), ")"));
    }
    auto entry = std::find_if(node->entries.begin(), node->entries.end(), [&](const auto& e) { return e.key == key; });
    if (entry == node->entries.end()) entry = node->entries.insert(entry, {key, at, {}});
    entry->at = at;
    node = &entry->value;
    begin = end + 1;
  }
  *node = std::move(value);
}

void set_override(Document& document, std::string_view assignment) {
  Errors errors;
  set_override(document, assignment, errors);
  errors.throw_if_any();
}

std::string print_text(std::string_view text) {
  static constexpr std::array<const char*, 13> kReserved = {"null", "none", "true", "false", "yes", "no",      "on",
                                                            "off",  "y",    "n",    "inf",   "nan", "infinity"};
  // Plain if it looks like a name or a path and like nothing else.
  std::string lower;
  bool plain = !text.empty() && (std::isalpha(static_cast<unsigned char>(text[0])) || text[0] == '_' || text[0] == '/');
  for (const char c : text) {
    const unsigned char u = static_cast<unsigned char>(c);
    plain = plain && u < 0x80 && (std::isalnum(u) || c == '_' || c == '/' || c == '.' || c == '-');
    lower += static_cast<char>(u < 0x80 ? std::tolower(u) : u);
  }
  for (const char* word : kReserved) plain = plain && lower != word;
  if (plain) return std::string(text);

  std::string quoted = "\"";
  for (const char c : text) {
    static constexpr const char* kHex = "0123456789abcdef";
    const unsigned char u = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      quoted += {'\\', c};
    else if (u < 0x20 || u == 0x7f)
      quoted += {'\\', 'x', kHex[u >> 4], kHex[u & 15]};
    else
      quoted += c;
  }
  return quoted + "\"";
}

std::string print_node(const Node& node) {
  switch (node.kind) {
    case Node::Kind::null:
      return "null";
    case Node::Kind::scalar: {
      // A plain scalar stays plain where that is safe, so that a number stays a number.
      const auto safe = [](unsigned char c) {
        return (c < 0x80 && std::isalnum(c)) || c == '+' || c == '-' || c == '_' || c == '.';
      };
      const size_t sign = node.text.starts_with('-') ? 1 : 0;
      const bool plain = !node.quoted && node.text.size() > sign && node.text[sign] != '-' && node.text != "..." &&
                         std::all_of(node.text.begin() + static_cast<std::ptrdiff_t>(sign), node.text.end(), safe);
      return plain ? node.text : print_text(node.text);
    }
    case Node::Kind::sequence:
    case Node::Kind::map:
      break;
  }
  std::string text;
  for (const Node& item : node.items) text += (text.empty() ? "" : ", ") + print_node(item);
  for (const Node::Entry& entry : node.entries)
    text += (text.empty() ? "" : ", ") + print_text(entry.key) + ": " + print_node(entry.value);
  return node.is_sequence() ? "[" + text + "]" : "{" + text + "}";
}

}  // namespace giga
