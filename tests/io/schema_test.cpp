// JSON schemas: what each kind of field becomes.
#include "io/schema.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <optional>

namespace giga::test {
namespace {

enum class Shade : uint8_t { light, dark };
constexpr std::array<const char*, 2> enum_names(Shade) { return {"light", "dark"}; }

struct Part {
  int count = 2;
};
template <class V>
void visit_fields(V& v, Part& c) {
  v("count", c.count, "how many", range(1, 9));
}

struct Config {
  bool flag = true;
  float share = 0.25f;
  std::optional<float> limit = std::nullopt;
  uint64_t seed = 1;
  std::vector<int> sizes = {64, 32};
  std::array<double, 2> pair = {0, 1};
  Shade shade = Shade::dark;
  std::string name = "x";
  Part group;
  std::vector<Part> list;
  std::map<std::string, Part> table;
  Node tree;
};
template <class V>
void visit_fields(V& v, Config& c) {
  v("flag", c.flag, "a switch");
  v("share", c.share, "a share", greater_than(0).below(1));
  v("limit", c.limit, "a limit", at_least(0));
  v("seed", c.seed, "a seed");
  v("sizes", c.sizes, "sizes", at_least(1).items(1, 4));
  v("pair", c.pair, "two");
  v("shade", c.shade, "a shade");
  v("name", c.name, "a name");
  v.group("group", c.group, "a group");
  v.list("list", c.list, "a list");
  v.table("table", c.table, "a table");
  v.tree("tree", c.tree, "a tree", fields_of_default<Part>);
}

/// The schema at a path such as {"properties", "flag"}, printed on one line.
std::string schema_at(std::initializer_list<const char*> path) {
  const Document document =
      parse_yaml_text(json_text(json_schema(fields_of_default<Config>(), "a title")), "the schema");  // JSON is YAML
  const Node* node = &document.root;
  for (const char* key : path) {
    node = node->is_sequence() ? &node->items.at(std::stoul(key)) : node->find(key);
    if (!node) return "nothing";
  }
  return print_node(*node);
}

TEST(JsonSchema, SaysWhatItIsAndRefusesOtherKeys) {
  EXPECT_EQ(schema_at({"$schema"}), "\"http://json-schema.org/draft-07/schema#\"");
  EXPECT_EQ(schema_at({"title"}), "\"a title\"");
  for (const auto& path : {std::initializer_list<const char*>{"additionalProperties"},
                           {"properties", "group", "additionalProperties"},
                           {"properties", "list", "items", "additionalProperties"},
                           {"properties", "table", "additionalProperties", "additionalProperties"},
                           {"properties", "tree", "additionalProperties"}})
    EXPECT_EQ(schema_at(path), "false");
}

TEST(JsonSchema, ValuesHaveTypeLimitsDocumentationAndDefault) {
  EXPECT_EQ(schema_at({"properties", "flag"}), "{type: boolean, description: \"a switch\", default: true}");
  EXPECT_EQ(schema_at({"properties", "share", "anyOf", "0"}),
            "{type: number, exclusiveMinimum: 0, exclusiveMaximum: 1}");
  EXPECT_EQ(schema_at({"properties", "share", "default"}), "0.25");
  EXPECT_EQ(schema_at({"properties", "limit", "anyOf", "0", "anyOf", "0", "minimum"}), "0");
  EXPECT_EQ(schema_at({"properties", "limit", "anyOf", "1", "enum"}), "[\"none\", null]");
  EXPECT_EQ(schema_at({"properties", "limit", "default"}), "\"none\"");
  EXPECT_EQ(schema_at({"properties", "seed", "anyOf", "0", "minimum"}), "0");
  EXPECT_EQ(schema_at({"properties", "sizes", "minItems"}), "1");
  EXPECT_EQ(schema_at({"properties", "sizes", "maxItems"}), "4");
  EXPECT_EQ(schema_at({"properties", "sizes", "items", "anyOf", "0", "maximum"}), "2147483647");  // that of int
  EXPECT_EQ(schema_at({"properties", "sizes", "default"}), "[64, 32]");
  EXPECT_EQ(schema_at({"properties", "pair", "minItems"}), "2");
  EXPECT_EQ(schema_at({"properties", "shade", "enum"}), "[light, dark]");
  EXPECT_EQ(schema_at({"properties", "name", "type"}), "string");
  for (const char* holder : {"group", "tree"})
    EXPECT_EQ(schema_at({"properties", holder, "properties", "count", "default"}), "2") << holder;
  EXPECT_EQ(schema_at({"properties", "list", "items", "properties", "count", "anyOf", "0", "maximum"}), "9");
}

}  // namespace
}  // namespace giga::test
