// Document: a YAML file as a tree that remembers where every key and value stands. Strict: what is ambiguous or clever
// in YAML (duplicate keys, anchors, aliases, tags, several documents) is an error with file, line and column.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace giga {

/// Where something was written. Line 0 = not from a file (`--set a.b`), then `source` says it all.
struct Position {
  std::shared_ptr<const std::string> source;
  int line = 0, column = 0;  ///< both count from 1

  std::string text() const;  ///< "FILE:LINE:COLUMN" or the source alone
};

/// Mistakes found in the user's input. They are collected, so that the user sees all of them at once.
class Errors {
 public:
  void add(const Position& at, const std::string& message);
  void add_all(const Errors& others);
  void add_all(const Errors& others, const Position& at);  ///< the others' messages, all at one place
  bool empty() const { return list_.empty(); }
  size_t size() const { return list_.size(); }
  bool full() const;                   ///< are there more than anybody reads? Then it is time to stop looking
  bool has(const Position& at) const;  ///< is there one at that very place?
  std::string text() const;            ///< one line each, by file, line and column
  void throw_if_any() const;           ///< throws one InputError with all of them

 private:
  struct Entry {
    Position at;
    std::string message;
  };
  std::vector<Entry> list_;
};

/// One value of a document: nothing, a scalar, a sequence or a map.
struct Node {
  enum class Kind : uint8_t { null, scalar, sequence, map };
  struct Entry;  ///< key and value of a map

  Kind kind = Kind::null;
  bool quoted = false;         ///< a scalar in quotes: a text, never a number or `none`
  std::string text;            ///< of a scalar
  Position at;                 ///< first character
  std::vector<Node> items;     ///< of a sequence
  std::vector<Entry> entries;  ///< of a map, in the order of the file

  bool is_null() const { return kind == Kind::null; }
  bool is_scalar() const { return kind == Kind::scalar; }
  bool is_sequence() const { return kind == Kind::sequence; }
  bool is_map() const { return kind == Kind::map; }
  /// Value of a key of a map; nullptr if there is none.
  const Node* find(std::string_view key) const;
  /// For messages: `'abc'`, `a list`, `a map`, `nothing`.
  std::string shown() const;
};

struct Node::Entry {
  std::string key;
  Position at;  ///< of the key
  Node value;
};

struct Document {
  std::string name;  ///< file name as given
  Node root;
};

/// Reads a file. Throws InputError with all errors found. A file may have 4 MiB.
Document parse_yaml_file(const std::filesystem::path& path);
/// The same, but errors are added to `errors`. After duplicate keys, anchors and tags the rest is still read; after
/// any other error the root is null.
Document parse_yaml_file(const std::filesystem::path& path, Errors& errors);

/// Reads a text; `name` stands for the file name in messages.
Document parse_yaml_text(std::string_view text, const std::string& name);
Document parse_yaml_text(std::string_view text, const std::string& name, Errors& errors);

/// Carries out `--set a.b.c=value`: the value, read as YAML, replaces what stands there; maps on the way are made.
void set_override(Document& document, std::string_view assignment);
void set_override(Document& document, std::string_view assignment, Errors& errors);

/// The tree as YAML on one line: `{a: 1, b: [x, y]}`.
std::string print_node(const Node& node);
/// A text as a YAML scalar, in quotes where a plain one would be read as something else.
std::string print_text(std::string_view text);

}  // namespace giga
