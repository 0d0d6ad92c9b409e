// The tables of the reference.
#include "config/reference.hpp"

#include <gtest/gtest.h>

#include <optional>

namespace giga {
namespace {

struct DocumentedPart {
  std::vector<int> sizes = {8};
};
template <class V>
void visit_fields(V& v, DocumentedPart& c) {
  v("sizes", c.sizes, "sizes", range(1, 9).items(1, 4));
}

struct DocumentedConfig {
  float gamma = 0.5f;
  std::optional<int> limit = std::nullopt;
  bool flag = false;
  std::string mode = "a";
  std::array<float, 2> pair = {1, 2};
  std::map<std::string, DocumentedPart> parts;
  Node rest;
};
template <class V>
void visit_fields(V& v, DocumentedConfig& c) {
  v("gamma", c.gamma, "a | b <c>", range(0, 1).below(1));
  v("limit", c.limit, "a limit", at_least(1));
  v("flag", c.flag, "a switch");
  v("mode", c.mode, "a mode", one_of({"a", "b"}));
  v("pair", c.pair, "two");
  v.table("parts", c.parts, "parts by name");
  v.tree("rest", c.rest, "others");
}

TEST(ConfigReference, OneTableForEachGroup) {
  EXPECT_EQ(reference_tables(fields_of_default<DocumentedConfig>(), "##", "elsewhere"),
            "| key | type | default | allowed | meaning |\n"
            "|---|---|---|---|---|\n"
            "| `gamma` | float | `0.5` | [0, 1) | a \\| b &lt;c> |\n"
            "| `limit` | int or none | `none` | >= 1 or none | a limit |\n"
            "| `flag` | bool | `false` |  | a switch |\n"
            "| `mode` | name | `a` | a, b | a mode |\n"
            "| `pair` | list of float | `[1, 2]` | 2 items | two |\n"
            "| `parts` | named groups |  |  | parts by name |\n"
            "| `rest` | map | `{}` | elsewhere | others |\n"
            "\n"
            "## `parts.NAME`\n"
            "\n"
            "Parts by name.\n"
            "\n"
            "| key | type | default | allowed | meaning |\n"
            "|---|---|---|---|---|\n"
            "| `sizes` | list of int | `[8]` | 1 to 4 items, each [1, 9] | sizes |\n");
}

}  // namespace
}  // namespace giga
