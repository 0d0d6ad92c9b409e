// Field lists: what is read, every kind of error with position and text, printing and reading back, listing.
#include "config/fields.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "config/names.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

enum class Shade { light, dark };
constexpr std::array<const char*, 2> enum_names(Shade) { return {"light", "dark"}; }
constexpr std::array<RenamedChoice, 1> renamed_choices(Shade) { return {{{"black", "dark"}}}; }

struct Critic {
  std::vector<int> hidden = {64, 64};
  Shade shade = Shade::light;
  bool operator==(const Critic&) const = default;
};
template <class V>
void visit_fields(V& v, Critic& c) {
  v("hidden", c.hidden, "hidden layer sizes", at_least(1).items(1, 4));
  v("shade", c.shade, "a name");
}

struct Part {
  std::string type = "default";
  int count = 1;
  bool operator==(const Part&) const = default;
};
template <class V>
void visit_fields(V& v, Part& c) {
  v("type", c.type, "kind");
  v("count", c.count, "how many", at_least(0));
  v.renamed("number", "count");
  v.removed("colour", "nothing is painted", "none");
}

struct Config {
  bool flag = false;
  int n_worlds = 8;
  int64_t steps = 100;
  uint64_t seed = 1;
  float gamma = 0.99f;
  double epsilon = 1e-5;
  std::string device = "auto", kind = "a";
  std::optional<int> limit = 500;
  std::optional<std::string> name;
  std::vector<float> weights;
  std::array<double, 2> pair = {0, 1};
  Critic critic;
  std::vector<Part> parts;
  std::map<std::string, Part> named;
  Node extra;
};
template <class V>
void visit_fields(V& v, Config& c) {
  v("flag", c.flag, "a switch");
  v("n_worlds", c.n_worlds, "number of worlds", at_least(1));
  v("steps", c.steps, "steps in all", range(0, 1e9));
  v("seed", c.seed, "seed");
  v("gamma", c.gamma, "discount", at_least(0).below(1));
  v("epsilon", c.epsilon, "small", greater_than(0).or_infinity());
  v("device", c.device, "where");
  v("kind", c.kind, "one of two", one_of({"a", "b"}));
  v("limit", c.limit, "time limit", at_least(1));
  v("name", c.name, "a name");
  v("weights", c.weights, "weights");
  v("pair", c.pair, "two numbers");
  v.group("critic", c.critic, "the value function");
  v.list("parts", c.parts, "parts in order");
  v.table("named", c.named, "parts by name");
  v.tree("extra", c.extra, "for others");
}

Config config_of(std::string_view text) {
  Config config;
  Errors errors;
  read_fields(parse_yaml_text(text, "f.yaml").root, config, errors);
  errors.throw_if_any();
  return config;
}

std::string errors_of(std::string_view text) {
  Config config;
  Errors errors;
  read_fields(parse_yaml_text(text, "f.yaml", errors).root, config, errors);
  return errors.text();
}

TEST(ConfigFields, ChangesOnlyTheKeysGiven) {
  const Config config = config_of("n_worlds: 64\ncritic: {shade: dark}\n");
  EXPECT_EQ(config.n_worlds, 64);
  EXPECT_EQ(config.critic.shade, Shade::dark);
  EXPECT_EQ(config.critic.hidden, (std::vector<int>{64, 64}));
  EXPECT_EQ(config.steps, 100);
}

TEST(ConfigFields, ReadsIntegersAsPeopleWriteThem) {
  EXPECT_EQ(config_of("steps: 300_000_000").steps, 300000000);
  EXPECT_EQ(config_of("steps: 3e8").steps, 300000000);
  EXPECT_EQ(config_of("steps: 1.5e3").steps, 1500);
  EXPECT_EQ(config_of("steps: +7").steps, 7);
  EXPECT_EQ(config_of("seed: 18446744073709551615").seed, 18446744073709551615u);
  EXPECT_EQ(config_of("seed: 1e19").seed, 10000000000000000000u) << "more than a double holds every integer of";
  EXPECT_EQ(config_of("seed: 1.8446744073709551615e19").seed, 18446744073709551615u);
  EXPECT_EQ(config_of("seed: 12.0").seed, 12u);
  for (const char* text : {"seed: e5", "seed: .e3", "seed: -e3", "seed: 1e", "seed: 1.5e0", "seed: 1e-1"})
    EXPECT_THROW(config_of(text), InputError) << text;
}

TEST(ConfigFields, ReadsEveryKindOfValue) {
  const Config config = config_of(
      "flag: true\ngamma: 5e-1\nepsilon: .inf\ndevice: cuda:1\nkind: b\nlimit: none\nname: 'none'\n"
      "weights: [1, -.5, 2e-3]\npair: [3, 4]\nparts: [{count: 2}, {type: x}]\nnamed: {p: {count: 3}}\n"
      "extra: {any: [1, {b: c}]}\n");
  EXPECT_TRUE(config.flag);
  EXPECT_EQ(config.gamma, 0.5f);
  EXPECT_TRUE(std::isinf(config.epsilon));
  EXPECT_EQ(config.device, "cuda:1");
  EXPECT_EQ(config.kind, "b");
  EXPECT_FALSE(config.limit);
  EXPECT_EQ(config.name, "none");
  EXPECT_EQ(config.weights, (std::vector<float>{1, -0.5f, 2e-3f}));
  EXPECT_EQ(config.pair, (std::array<double, 2>{3, 4}));
  EXPECT_EQ(config.parts, (std::vector<Part>{{"default", 2}, {"x", 1}}));
  EXPECT_EQ(config.named.at("p"), (Part{"default", 3}));
  EXPECT_EQ(print_node(config.extra), "{any: [1, {b: c}]}");
}

TEST(ConfigFields, SaysWhereAndWhatIsAllowed) {
  const std::pair<const char*, const char*> cases[] = {
      {"n_worlds: abc", "f.yaml:1:11: n_worlds: 'abc' is not an integer >= 1"},
      {"n_worlds: 0", "f.yaml:1:11: n_worlds: '0' is not an integer >= 1"},
      {"n_worlds: 2.5", "f.yaml:1:11: n_worlds: '2.5' is not an integer >= 1"},
      {"n_worlds: '2'", "f.yaml:1:11: n_worlds: '\"2\"' is not an integer >= 1"},
      {"n_worlds: 3000000000", "f.yaml:1:11: n_worlds: '3000000000' is not an integer in [1, 2147483647]"},
      {"n_worlds: 3e9", "f.yaml:1:11: n_worlds: '3e9' is not an integer in [1, 2147483647]"},
      {"n_worlds: 1__0", "f.yaml:1:11: n_worlds: '1__0' is not an integer >= 1"},
      {"n_worlds: [1]", "f.yaml:1:11: n_worlds: a list is not an integer >= 1"},
      {"n_worlds:", "f.yaml:1:1: n_worlds: nothing is not an integer >= 1"},
      {"steps: 2e9", "f.yaml:1:8: steps: '2e9' is not an integer in [0, 1000000000]"},
      {"seed: -1", "f.yaml:1:7: seed: '-1' is not an integer in [0, 18446744073709551615]"},
      {"seed: x", "f.yaml:1:7: seed: 'x' is not an integer >= 0"},
      {"gamma: 1", "f.yaml:1:8: gamma: '1' is not a number in [0, 1)"},
      {"gamma: nan", "f.yaml:1:8: gamma: 'nan' is not a finite number in [0, 1)"},
      {"gamma: .nan", "f.yaml:1:8: gamma: '.nan' is not a finite number in [0, 1)"},
      {"gamma: .inf", "f.yaml:1:8: gamma: '.inf' is not a finite number in [0, 1)"},
      {"gamma: 1e999", "f.yaml:1:8: gamma: '1e999' is not a number of 32 bits in [0, 1)"},
      {"gamma: 1e-60", "f.yaml:1:8: gamma: '1e-60' is not a number of 32 bits in [0, 1)"},
      {"epsilon: 0", "f.yaml:1:10: epsilon: '0' is not a number > 0 or inf"},
      {"flag: yes", "f.yaml:1:7: flag: 'yes' is not true or false"},
      {"kind: A", "f.yaml:1:7: kind: 'A' is not one of: a, b; nearest: 'a'"},
      {"limit: 0", "f.yaml:1:8: limit: '0' is not an integer >= 1 or none"},
      {"device: {}", "f.yaml:1:9: device: a map is not a text"},
      {"weights: 3", "f.yaml:1:10: weights: '3' is not a list, each a number; write [3]"},
      {"pair: 3, 4", "f.yaml:1:7: pair: '3, 4' is not a list of 2 items, each a number; write [3, 4]"},
      {"pair: 3", "f.yaml:1:7: pair: '3' is not a list of 2 items, each a number"},  // [3] would be none either
      {"weights: [1, x]", "f.yaml:1:14: weights[1]: 'x' is not a number"},
      {"pair: [1]", "f.yaml:1:7: pair: has 1 item, expected a list of 2 items, each a number"},
      {"critic:\n  shade: drak", "f.yaml:2:10: critic.shade: 'drak' is not one of: light, dark; nearest: 'dark'"},
      {"critic: {hidden: []}",
       "f.yaml:1:18: critic.hidden: has 0 items, expected a list of 1 to 4 items, each an integer >= 1"},
      {"critic: 3", "f.yaml:1:9: critic: is '3', expected a map with keys out of: hidden, shade"},
      {"critic:", "f.yaml:1:1: critic: is empty, expected a map with keys out of: hidden, shade"},
      {"critic: {hiden: [1]}", "f.yaml:1:10: critic.hiden: unknown key; nearest: 'hidden'; allowed: hidden, shade"},
      {"parts: {a: 1}", "f.yaml:1:8: parts: a map is not a list of groups, [{key: value, ...}, ...]"},
      {"parts: [{count: x}]", "f.yaml:1:17: parts[0].count: 'x' is not an integer >= 0"},
      {"named: []", "f.yaml:1:8: named: a list is not a map of groups, {name: {key: value, ...}, ...}"},
      {"named: {p: {counts: 1}}", "f.yaml:1:13: named.p.counts: unknown key; nearest: 'count'; allowed: type, count"},
      {"extra: 3", "f.yaml:1:8: extra: '3' is not a map"},
      {"parts: [{number: 1}]", "f.yaml:1:10: parts[0].number: this key is now called 'count'"},
      {"parts: [{colour: red}]", "f.yaml:1:10: parts[0].colour: there is no such key any more: nothing is painted"},
      {"critic: {shade: black}", "f.yaml:1:17: critic.shade: 'black' is now called 'dark'"},
  };
  for (const auto& [text, expected] : cases) EXPECT_EQ(errors_of(text), expected) << text;
}

// As configs of runs state it that were made while there was such a key.
TEST(ConfigFields, AKeyThatIsGoneMayHaveTheValueThatChangedNothing) {
  EXPECT_EQ(errors_of("parts: [{colour: none, count: 2}]"), "");
}

TEST(ConfigFields, ListsAllErrorsOfAFile) {
  EXPECT_EQ(errors_of("n_worlds: 0\nflag: 3\nflag: true\ngama: 1\n"),
            "f.yaml:1:11: n_worlds: '0' is not an integer >= 1\n"
            "f.yaml:2:7: flag: '3' is not true or false\n"
            "f.yaml:3:1: duplicate key 'flag', first given at line 2\n"
            "f.yaml:4:1: gama: unknown key; nearest: 'gamma'; allowed: flag, n_worlds, steps, seed, gamma, epsilon, "
            "device, kind, limit, name, weights, pair, critic, parts, named, extra");
}

TEST(ConfigFields, AFailedReadLeavesTheMemberAlone) {
  Config config;
  Errors errors;
  read_fields(parse_yaml_text("n_worlds: 0\nweights: [1, x]\n", "f.yaml").root, config, errors);
  EXPECT_EQ(config.n_worlds, 8);
  EXPECT_TRUE(config.weights.empty());
}

TEST(ConfigFields, AnEmptyDocumentIsAnError) {
  EXPECT_EQ(errors_of("").substr(0, 60), "f.yaml:1:1: is empty, expected a map with keys out of: flag,");
}

TEST(ConfigFields, TellsWhereKeysWereGiven) {
  Config config;
  Errors errors;
  KeyPositions given;
  read_fields(parse_yaml_text("critic:\n  shade: dark\nparts: [{}, {count: 2}]\n", "f.yaml").root, config, errors,
              &given);
  EXPECT_EQ(given.at("critic.shade").text(), "f.yaml:2:10");
  EXPECT_EQ(given.at("parts[1].count").text(), "f.yaml:3:21");
  EXPECT_FALSE(given.contains("n_worlds"));
}

TEST(ConfigFields, FileAndOverrides) {
  const std::string path = testing::TempDir() + "config_fields_test.yaml";
  std::ofstream(path) << "n_worlds: 3\ncritic: {shade: dark}\n";
  Config config;
  Errors errors;
  EXPECT_TRUE(read_config_file(path, {"n_worlds=5", "critic.hidden=[7]"}, config, errors));
  EXPECT_EQ(config.n_worlds, 5);
  EXPECT_EQ(config.critic, (Critic{{7}, Shade::dark}));
  EXPECT_TRUE(errors.empty());
  EXPECT_TRUE(read_config_file(path, {"n_worlds=x", "critic.shad=dark", "nonsense"}, config, errors));
  EXPECT_EQ(errors.text(),
            "--set nonsense: expected KEY=VALUE\n"
            "--set n_worlds: 'x' is not an integer >= 1\n"
            "--set critic.shad: unknown key; nearest: 'shade'; allowed: hidden, shade");
}

/// Only a tree, of which all keys are known.
struct Wrapped {
  Node inner;
};
template <class V>
void visit_fields(V& v, Wrapped& c) {
  v.tree("inner", c.inner, "keys of Config", fields_of_default<Config>);
}

TEST(ConfigFields, AHintNamesOnlyKeysThatThereAre) {
  const auto told = [](const char* text) {
    Wrapped wrapped;
    Errors errors;
    read_fields(parse_yaml_text(text, "f.yaml").root, wrapped, errors);
    return errors.text();
  };
  const std::string start = "f.yaml:1:1: ", end = " Allowed here: inner";
  EXPECT_EQ(told("critic: {shade: dark}"), start + "critic: unknown key; did you mean 'inner.critic.shade'?" + end);
  EXPECT_EQ(told("critics: {shade: dark}"), start + "critics: unknown key; did you mean 'inner.critic.shade'?" + end);
  EXPECT_EQ(told("named: {p: {count: 1}}"), start + "named: unknown key; did you mean 'inner.named.p.count'?" + end);
  // There is no critic.gamma: the group may be meant where its name is the same, not where it is only alike.
  EXPECT_EQ(told("critic: {gamma: 1}"), start + "critic: unknown key; did you mean 'inner.critic'?" + end);
  EXPECT_EQ(told("critics: {gamma: 1}"), start + "critics: unknown key; allowed: inner");
}

TEST(ConfigFields, AssignmentsAreCheckedEvenWhereTheFileCannotBeRead) {
  Config config;
  Errors errors;
  EXPECT_FALSE(read_config_file("/nowhere/f.yaml", {"n_worlds=x"}, config, errors));
  EXPECT_EQ(errors.text(),
            "/nowhere/f.yaml: no such file\n"
            "--set n_worlds: 'x' is not an integer >= 1");
  const std::string path = testing::TempDir() + "config_fields_empty_test.yaml";
  std::ofstream(path) << "";
  Errors of_empty;
  EXPECT_FALSE(read_config_file(path, {}, config, of_empty));
  EXPECT_EQ(of_empty.text().substr(0, path.size() + 15), path + ":1:1: is empty,");
}

TEST(ConfigFields, KnowsWhichKeysAreWrong) {
  Config config;
  Errors errors;
  KeyPositions given;
  const Document document =
      parse_yaml_text("critic: {shade: drak}\nn_wrlds: 3\nparts: [{}, {count: x}]\ngamma: 0.5\n", "f.yaml");
  read_fields(document.root, config, errors, &given);
  EXPECT_TRUE(is_wrong("critic.shade", given, errors));
  EXPECT_TRUE(is_wrong("critic", given, errors));
  EXPECT_FALSE(is_wrong("critic.hidden", given, errors));
  EXPECT_TRUE(is_wrong("n_worlds", given, errors));  // what was meant is not known
  EXPECT_TRUE(is_wrong("parts[1].count", given, errors));
  EXPECT_FALSE(is_wrong("parts[0]", given, errors));
  EXPECT_FALSE(is_wrong("gamma", given, errors));
  EXPECT_FALSE(is_wrong("flag", given, errors));
}

TEST(ConfigPrint, ReadsBackBitForBit) {
  std::mt19937 random(7);
  for (int round = 0; round < 300; ++round) {
    Config config;
    const auto any_float = [&] {
      for (;;) {
        const uint32_t bits = static_cast<uint32_t>(random());
        float value;
        static_assert(sizeof value == sizeof bits);
        std::memcpy(&value, &bits, sizeof value);
        if (std::isfinite(value)) return value;
      }
    };
    config.weights = {any_float(), any_float(), -0.0f, 0.1f, std::numeric_limits<float>::denorm_min()};
    config.epsilon = round == 0 ? std::numeric_limits<double>::infinity() : std::abs(any_float()) * 1.1 + 1e-300;
    config.seed = (static_cast<uint64_t>(random()) << 32) | random();
    config.limit = round % 2 ? std::optional<int>(round) : std::nullopt;
    config.name = round % 3 ? std::optional<std::string>("none") : std::nullopt;
    config.device = "a: \"b\" #c\n\x01";
    config.parts = {{"x y", 1}, {"null", round}};
    config.named = {{"p.q", {"true", 2}}, {"1", {}}};
    config.extra = parse_yaml_text("{a: [1, 'none', ~], b: {c: -5}}", "x").root;
    for (const bool comments : {false, true}) {
      const std::string text = print_yaml(config, comments);
      const Config back = config_of(text);
      EXPECT_EQ(print_yaml(back, comments), text);
      ASSERT_EQ(back.weights.size(), config.weights.size());
      for (size_t k = 0; k < config.weights.size(); ++k)
        EXPECT_EQ(std::memcmp(&back.weights[k], &config.weights[k], sizeof(float)), 0) << config.weights[k];
      EXPECT_EQ(back.epsilon, config.epsilon);
      EXPECT_EQ(back.seed, config.seed);
      EXPECT_EQ(back.limit, config.limit);
      EXPECT_EQ(back.name, config.name);
      EXPECT_EQ(back.device, config.device);
      EXPECT_EQ(back.parts, config.parts);
      EXPECT_EQ(back.named, config.named);
    }
  }
}

TEST(ConfigPrint, CommentsTellDocumentationDefaultAndLimits) {
  Critic critic;
  critic.hidden = {8};
  EXPECT_EQ(print_yaml(critic, true),
            "# hidden layer sizes (default [64, 64]; a list of 1 to 4 items, each an integer >= 1)\n"
            "hidden: [8]\n"
            "shade: light                            # a name (default light; one of: light, dark)\n");
  EXPECT_EQ(print_yaml(critic, false), "hidden: [8]\nshade: light\n");
}

TEST(ConfigList, NamesEveryKeyWithTypeDefaultAndLimits) {
  std::map<std::string, FieldInfo> all;
  for (const FieldInfo& info : list_fields<Config>()) all[info.path] = info;
  EXPECT_EQ(all.size(), 22u);
  EXPECT_EQ(all.at("gamma").type, "float");
  EXPECT_EQ(all.at("gamma").default_value, "0.99");
  EXPECT_EQ(all.at("gamma").expected, "a number in [0, 1)");
  EXPECT_EQ(all.at("gamma").doc, "discount");
  EXPECT_EQ(all.at("limit").type, "int or none");
  EXPECT_EQ(all.at("critic").shape, FieldShape::group);
  EXPECT_EQ(all.at("critic.hidden").type, "list of int");
  EXPECT_EQ(all.at("critic.shade").type, "name");
  EXPECT_EQ(all.at("parts[].count").default_value, "1");
  EXPECT_EQ(all.at("named.<name>.type").default_value, "default");
}

TEST(ConfigNames, NearestByEditDistance) {
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(edit_distance("gamma", "gama"), 1);
  EXPECT_EQ(edit_distance("drak", "dark"), 1);  // a swap
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);
  const std::vector<std::string> known = {"n_worlds", "n_epochs", "horizon"};
  EXPECT_EQ(nearest_names("n_wrlds", known), (std::vector<std::string>{"n_worlds"}));
  EXPECT_EQ(nearest_names("worlds", known, 1), (std::vector<std::string>{"n_worlds"}));
  EXPECT_TRUE(nearest_names("xyzzy", known).empty());
  // Four edits away. An option's dashes do not count: half of six letters is less, half of eight is not.
  EXPECT_TRUE(nearest_names("--epochs", {"--gpus"}).empty());
}

}  // namespace
}  // namespace giga
