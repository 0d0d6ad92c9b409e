// Field lists: a config struct names its keys once, with documentation and limits; reading, printing, `--set` and the
// reference of all keys follow from that one function, which stands next to the struct:
//
//   template <class V>
//   void visit_fields(V& v, TrainConfig& c) {
//     v("gamma", c.gamma, "discount of one step", range(0, 1));
//     v.group("critic", c.critic, "the value function");
//   }
//
// Values: bool, int, int64_t, uint64_t, float, double, std::string, enums with an `enum_names(Enum)` beside them (and a
// `renamed_choices(Enum)` where names have changed), std::vector, std::array and std::optional of these, and every type
// with a FieldCodec.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "config/document.hpp"

namespace giga {

/// What a value may be; of lists, each item.
struct Allowed {
  double lo = -std::numeric_limits<double>::infinity();
  double hi = std::numeric_limits<double>::infinity();
  bool lo_open = false, hi_open = false;  ///< the limit itself is not allowed
  bool infinity = false;                  ///< `inf` and `-inf` are numbers here
  std::vector<std::string> choices;       ///< of texts; empty = any
  std::string pattern;                    ///< of texts, for schemas: a regular expression; empty = any
  size_t min_items = 0;                   ///< of lists
  size_t max_items = std::numeric_limits<size_t>::max();

  Allowed below(double limit) const;                                                    ///< and less than the limit
  Allowed at_most(double limit) const;                                                  ///< and not more than the limit
  Allowed or_infinity() const;                                                          ///< or infinite
  Allowed items(size_t least, size_t most = std::numeric_limits<size_t>::max()) const;  ///< and so many items

  bool contains(double value) const;
  std::string limits_text() const;  ///< " >= 1", " in [0, 1)", or nothing
};

Allowed anything();
Allowed range(double lo, double hi);  ///< lo and hi included
Allowed at_least(double lo);
Allowed greater_than(double lo);
Allowed one_of(std::vector<std::string> choices);

/// What a value is made of. The type in the reference and the schema for editors follow from it.
struct ValueShape {
  enum class Kind : uint8_t { boolean, integer, real, text, duration, none, list, either };

  Kind kind = Kind::text;
  Allowed allowed = {};                ///< limits of numbers, choices of texts, number of items of lists
  std::vector<ValueShape> parts = {};  ///< list: what an item is; either: what the value may be

  std::string type() const;  ///< "int", "list of text", "float or none"
};

/// Where a value is being read: its path for messages, and the place for errors.
struct ReadSite {
  std::string path;
  Errors& errors;
  std::string alternative = {};  ///< " or none" inside an optional

  /// Adds "path: 'x' is not <expected>"; returns false.
  bool fail(const Node& node, const std::string& expected) const;
};

/// How a type is read from and printed to YAML. Specialise it for a type of your own:
///   static bool read(const Node&, T&, const Allowed&, const ReadSite&)  reports to the site and returns false on error
///   static std::string print(const T&)                                   text that reads back to the same value
///   static std::string expected(const Allowed&)                          "an integer >= 1"
///   static ValueShape shape(const Allowed&)                              what it is made of
template <class T>
struct FieldCodec;

/// bool, int, int64_t, uint64_t, float, double, std::string.
template <class T>
struct ScalarCodec {
  static bool read(const Node& node, T& value, const Allowed& allowed, const ReadSite& site);
  static std::string print(const T& value);
  static std::string expected(const Allowed& allowed);
  static ValueShape shape(const Allowed& allowed);
};
template <>
struct FieldCodec<bool> : ScalarCodec<bool> {};
template <>
struct FieldCodec<int> : ScalarCodec<int> {};
template <>
struct FieldCodec<int64_t> : ScalarCodec<int64_t> {};
template <>
struct FieldCodec<uint64_t> : ScalarCodec<uint64_t> {};
template <>
struct FieldCodec<float> : ScalarCodec<float> {};
template <>
struct FieldCodec<double> : ScalarCodec<double> {};
template <>
struct FieldCodec<std::string> : ScalarCodec<std::string> {};

/// The number that a plain YAML scalar is to these codecs, as 10_000 or 3e8; none where it is none.
std::optional<double> plain_number(const std::string& text);

/// A choice that once had another name.
struct RenamedChoice {
  const char *before, *now;
};

/// Index of the scalar in `names`, or -1 after reporting it.
int read_choice(const Node& node, const std::vector<std::string>& names, const ReadSite& site,
                const std::vector<RenamedChoice>& renamed = {});
std::string expected_choice(const std::vector<std::string>& names);
std::string expected_list(const Allowed& allowed, const std::string& item);
/// Checks that the node is a list of an allowed length.
bool read_list_shape(const Node& node, const Allowed& allowed, const std::string& expected, const ReadSite& site);
bool is_none(const Node& node);

template <class T>
concept Enumeration = std::is_enum_v<T>;

template <Enumeration T>
struct FieldCodec<T> {
  static std::vector<std::string> names() {
    std::vector<std::string> list;
    for (const auto& name : enum_names(T{})) list.emplace_back(name);
    return list;
  }
  static bool read(const Node& node, T& value, const Allowed&, const ReadSite& site) {
    std::vector<RenamedChoice> renamed;
    if constexpr (requires { renamed_choices(T{}); })
      for (const RenamedChoice& r : renamed_choices(T{})) renamed.push_back(r);
    const int index = read_choice(node, names(), site, renamed);
    if (index >= 0) value = static_cast<T>(index);
    return index >= 0;
  }
  static std::string print(const T& value) { return names().at(static_cast<size_t>(value)); }
  static std::string expected(const Allowed&) { return expected_choice(names()); }
  static ValueShape shape(const Allowed&) { return {ValueShape::Kind::text, one_of(names())}; }
};

template <class T>
struct FieldCodec<std::vector<T>> {
  using Item = FieldCodec<T>;
  static bool read(const Node& node, std::vector<T>& value, const Allowed& allowed, const ReadSite& site) {
    if (!read_list_shape(node, allowed, expected(allowed), site)) return false;
    std::vector<T> items(node.items.size());
    bool good = true;
    for (size_t k = 0; k < items.size(); ++k) {
      const ReadSite item_site{site.path + "[" + std::to_string(k) + "]", site.errors};
      good = Item::read(node.items[k], items[k], allowed, item_site) && good;
    }
    if (good) value = std::move(items);
    return good;
  }
  static std::string print(const std::vector<T>& value) {
    std::string text = "[";
    for (const T& item : value) text += (text.size() > 1 ? ", " : "") + Item::print(item);
    return text + "]";
  }
  static std::string expected(const Allowed& allowed) { return expected_list(allowed, Item::expected(allowed)); }
  static ValueShape shape(const Allowed& allowed) { return {ValueShape::Kind::list, allowed, {Item::shape(allowed)}}; }
};

/// A list of exactly N items.
template <class T, size_t N>
struct FieldCodec<std::array<T, N>> {
  using List = FieldCodec<std::vector<T>>;
  static bool read(const Node& node, std::array<T, N>& value, const Allowed& allowed, const ReadSite& site) {
    std::vector<T> items;
    if (!List::read(node, items, allowed.items(N, N), site)) return false;
    for (size_t k = 0; k < N; ++k) value[k] = items[k];
    return true;
  }
  static std::string print(const std::array<T, N>& value) { return List::print({value.begin(), value.end()}); }
  static std::string expected(const Allowed& allowed) { return List::expected(allowed.items(N, N)); }
  static ValueShape shape(const Allowed& allowed) { return List::shape(allowed.items(N, N)); }
};

template <class T>
struct FieldCodec<std::optional<T>> {
  using Inner = FieldCodec<T>;
  static bool read(const Node& node, std::optional<T>& value, const Allowed& allowed, const ReadSite& site) {
    if (is_none(node)) {
      value.reset();
      return true;
    }
    T inner{};
    if (!Inner::read(node, inner, allowed, {site.path, site.errors, " or none"})) return false;
    value = std::move(inner);
    return true;
  }
  static std::string print(const std::optional<T>& value) { return value ? Inner::print(*value) : "none"; }
  static std::string expected(const Allowed& allowed) { return Inner::expected(allowed) + " or none"; }
  static ValueShape shape(const Allowed& allowed) {
    return {ValueShape::Kind::either, {}, {Inner::shape(allowed), {ValueShape::Kind::none}}};
  }
};

struct Field;
enum class FieldShape : uint8_t { value, group, list, table, tree };

/// The keys of one struct, bound to its members. `visit_fields` fills it through the call operator and its siblings.
class FieldList {
 public:
  /// A value.
  template <class T>
  void operator()(const std::string& name, T& value, const std::string& doc, const Allowed& allowed = {});
  /// A struct with keys of its own.
  template <class T>
  void group(const std::string& name, T& value, const std::string& doc);
  /// A sequence of such structs; what is given replaces the whole.
  template <class T>
  void list(const std::string& name, std::vector<T>& values, const std::string& doc);
  /// Named structs: a map from names, which the user chooses, to structs. A given entry replaces one of that name.
  template <class T>
  void table(const std::string& name, std::map<std::string, T>& values, const std::string& doc);
  /// A map that somebody else reads; `keys` gives those that it may have, where that is known.
  void tree(const std::string& name, Node& value, const std::string& doc, std::function<FieldList()> keys = {});

  /// A key that was once called `before`: whoever still writes it is told the new name.
  void renamed(const std::string& before, const std::string& now) { renamed_[before] = now; }
  /// A key that there was once: who still writes it is told what to write `instead`. Not where it is `idle`, a value
  /// that changed nothing: configs of older runs state all keys.
  void removed(const std::string& name, const std::string& instead, const std::string& idle = {}) {
    removed_[name] = {instead, idle};
  }

  const std::vector<Field>& fields() const { return fields_; }
  const std::map<std::string, std::string>& renamed() const { return renamed_; }
  struct Removed {
    std::string instead, idle;
  };
  const std::map<std::string, Removed>& removed() const { return removed_; }
  void keep(std::shared_ptr<void> owner) { owner_ = std::move(owner); }

 private:
  Field& add(FieldShape shape, const std::string& name, const std::string& doc);

  std::vector<Field> fields_;
  std::map<std::string, std::string> renamed_;  // new names by old ones
  std::map<std::string, Removed> removed_;
  std::shared_ptr<void> owner_;  // of the struct, where nobody else holds it
};

/// One key: what is known about it, and how to reach the member behind it.
struct Field {
  std::string name, doc;
  FieldShape shape = FieldShape::value;
  std::string type, expected;

  ValueShape value;                                        ///< value
  std::function<bool(const Node&, const ReadSite&)> read;  ///< value
  std::function<std::string()> print;                      ///< value, tree
  FieldList members;                                       ///< group
  std::function<FieldList()> example;                      ///< list, table: an element of defaults; tree: all keys
  std::function<void()> clear;                             ///< list
  std::function<FieldList(const std::string&)> add;        ///< list (the name is ignored), table: a fresh element
  std::function<std::vector<std::pair<std::string, FieldList>>()> elements;  ///< list, table
  std::function<void(const Node&)> assign;                                   ///< tree
};

template <class T>
FieldList fields_of(T& config) {
  FieldList list;
  visit_fields(list, config);
  return list;
}

template <class T>
FieldList fields_of_default() {
  auto config = std::make_shared<T>();
  FieldList list = fields_of(*config);
  list.keep(std::move(config));
  return list;
}

template <class T>
void FieldList::operator()(const std::string& name, T& value, const std::string& doc, const Allowed& allowed) {
  using Codec = FieldCodec<T>;
  Field& field = add(FieldShape::value, name, doc);
  field.value = Codec::shape(allowed);
  field.type = field.value.type();
  field.expected = Codec::expected(allowed);
  field.read = [&value, allowed](const Node& node, const ReadSite& site) {
    return Codec::read(node, value, allowed, site);
  };
  field.print = [&value] { return Codec::print(value); };
}

template <class T>
void FieldList::group(const std::string& name, T& value, const std::string& doc) {
  Field& field = add(FieldShape::group, name, doc);
  field.members = fields_of(value);
}

template <class T>
void FieldList::list(const std::string& name, std::vector<T>& values, const std::string& doc) {
  Field& field = add(FieldShape::list, name, doc);
  field.example = [] { return fields_of_default<T>(); };
  field.clear = [&values] { values.clear(); };
  field.add = [&values](const std::string&) { return fields_of(values.emplace_back()); };
  field.elements = [&values] {
    std::vector<std::pair<std::string, FieldList>> all;
    for (T& value : values) all.emplace_back("", fields_of(value));
    return all;
  };
}

template <class T>
void FieldList::table(const std::string& name, std::map<std::string, T>& values, const std::string& doc) {
  Field& field = add(FieldShape::table, name, doc);
  field.example = [] { return fields_of_default<T>(); };
  field.add = [&values](const std::string& key) { return fields_of(values[key] = T{}); };
  field.elements = [&values] {
    std::vector<std::pair<std::string, FieldList>> all;
    for (auto& [key, value] : values) all.emplace_back(key, fields_of(value));
    return all;
  };
}

/// Where each key that was given stands, by path ("train.gamma"); of keys set twice, the last. A misspelt
/// key counts for the one that it may have meant.
using KeyPositions = std::map<std::string, Position>;

/// Sets the members whose keys the map gives; unknown keys and unusable values go to `errors`. `path` stands before
/// the keys in messages; `given` learns where each key was found.
void read_fields(const Node& node, const FieldList& fields, Errors& errors, KeyPositions* given = nullptr,
                 const std::string& path = "");
template <class T>
void read_fields(const Node& node, T& config, Errors& errors, KeyPositions* given = nullptr) {
  read_fields(node, fields_of(config), errors, given);
}

/// Reads a file and `--set` assignments into a struct. Returns false where the file as a whole cannot be read.
bool read_config_file(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                      const FieldList& fields, Errors& errors, KeyPositions* given = nullptr);
/// The same of a file that was read; `has_errors`: with errors, which have been added.
bool read_config_document(Document document, bool has_errors, const std::vector<std::string>& overrides,
                          const FieldList& fields, Errors& errors, KeyPositions* given = nullptr);
template <class T>
bool read_config_file(const std::filesystem::path& file, const std::vector<std::string>& overrides, T& config,
                      Errors& errors, KeyPositions* given = nullptr) {
  return read_config_file(file, overrides, fields_of(config), errors, given);
}

/// Whether there is an error at a key, inside it or around it. The struct then does not hold what the user meant, and
/// further checks of this value would mislead.
bool is_wrong(const std::string& key, const KeyPositions& given, const Errors& errors);

/// All keys with their values as YAML, which reads back to the same struct bit for bit. With comments: documentation,
/// default and limits behind each key.
std::string print_yaml(const FieldList& fields, const FieldList& defaults, bool with_comments);
template <class T>
std::string print_yaml(const T& config, bool with_comments) {
  T copy = config;
  return print_yaml(fields_of(copy), fields_of_default<T>(), with_comments);
}

/// One key of a struct, flat. Elements of lists have paths like `team_0[].count`, those of tables `maps.<name>.boxes`.
struct FieldInfo {
  std::string path, type, default_value, expected, doc;
  FieldShape shape = FieldShape::value;
};
std::vector<FieldInfo> list_fields(const FieldList& defaults);
template <class T>
std::vector<FieldInfo> list_fields() {
  return list_fields(fields_of_default<T>());
}

}  // namespace giga
