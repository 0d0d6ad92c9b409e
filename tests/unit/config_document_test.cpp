// The YAML reader: the tree with its positions, every kind of rejected file, overrides.
#include "config/document.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "core/error.hpp"

namespace giga {
namespace {

/// What reading the text complains about; empty if nothing.
std::string parse_errors_of(std::string_view text) {
  Errors errors;
  parse_yaml_text(text, "f.yaml", errors);
  return errors.text();
}

TEST(ConfigDocument, RemembersWhereKeysAndValuesStand) {
  const Document document = parse_yaml_text("a: 1\nb:\n  c: [x, 'y']\n  d: {e: null}\n", "f.yaml");
  const Node& root = document.root;
  ASSERT_TRUE(root.is_map());
  EXPECT_EQ(root.find("a")->text, "1");
  EXPECT_EQ(root.find("a")->at.text(), "f.yaml:1:4");
  const Node& b = *root.find("b");
  ASSERT_EQ(b.entries.size(), 2u);
  EXPECT_EQ(b.entries[1].at.text(), "f.yaml:4:3");
  const Node& c = *b.find("c");
  ASSERT_TRUE(c.is_sequence());
  EXPECT_FALSE(c.items[0].quoted);
  EXPECT_TRUE(c.items[1].quoted);
  EXPECT_EQ(c.items[1].at.text(), "f.yaml:3:10");
  EXPECT_TRUE(b.find("d")->find("e")->is_null());
  EXPECT_EQ(root.find("nothing"), nullptr);
}

TEST(ConfigDocument, RejectsWhatIsAmbiguousOrClever) {
  EXPECT_EQ(parse_errors_of("a: 1\nb: 2\na: 3\n"), "f.yaml:3:1: duplicate key 'a', first given at line 1");
  EXPECT_EQ(parse_errors_of("a: {b: 1, b: 2}\n"), "f.yaml:1:11: duplicate key 'b', first given at line 1");
  EXPECT_EQ(parse_errors_of("a: &x 1\nb: *x\n"),
            "f.yaml:1:4: anchors are not allowed: &x; write the value where it is needed\n"
            "f.yaml:2:4: aliases are not allowed: *x; write the value itself");
  EXPECT_EQ(parse_errors_of("a: !!int 1\n"),
            "f.yaml:1:4: tags are not allowed: tag:yaml.org,2002:int; write the value alone");
  EXPECT_EQ(parse_errors_of("a: !mine {b: 1}\nc: !mine []\n"),
            "f.yaml:1:4: tags are not allowed: !mine; write the value alone\n"
            "f.yaml:2:4: tags are not allowed: !mine; write the value alone");
  EXPECT_EQ(parse_errors_of("a: 1\n---\nb: 2\n"),
            "f.yaml:3:1: a second document starts here; a file may have one only");
  EXPECT_EQ(parse_errors_of("[a, b]: 1\n"), "f.yaml:1:1: a key must be a name, not a list");
  EXPECT_FALSE(parse_errors_of("a: 1\n---\n").empty());
}

TEST(ConfigDocument, RejectsWhatIsNotYamlText) {
  EXPECT_EQ(parse_errors_of("a: [1, 2\nb: 3\n").substr(0, 28), "f.yaml:2:2: not valid YAML: ");
  EXPECT_EQ(parse_errors_of("a: 1\nb: \xC3(\n"), "f.yaml:2:4: not UTF-8: byte 195; save the file as UTF-8");
  EXPECT_EQ(parse_errors_of("# \xED\xA0\x80"),
            "f.yaml:1:3: not UTF-8: byte 237; save the file as UTF-8");                                 // a surrogate
  EXPECT_EQ(parse_errors_of("# \xC0\xAF"), "f.yaml:1:3: not UTF-8: byte 192; save the file as UTF-8");  // overlong
  EXPECT_EQ(parse_errors_of(std::string_view("a: \0", 4)),
            "f.yaml:1:4: control character 0; a file may hold text only");
  EXPECT_EQ(parse_errors_of(std::string(5000, '[')), "f.yaml:1:1: nested too deeply");
  EXPECT_EQ(parse_errors_of("a: \xC3\xA4\xF0\x9F\x9A\x80\n"), "");
}

TEST(ConfigDocument, ListsAllErrorsByPosition) {
  EXPECT_EQ(parse_errors_of("a: &x 1\na: 2\nb: !t 3\n"),
            "f.yaml:1:4: anchors are not allowed: &x; write the value where it is needed\n"
            "f.yaml:2:1: duplicate key 'a', first given at line 1\n"
            "f.yaml:3:4: tags are not allowed: !t; write the value alone");
}

TEST(ConfigDocument, SaysWhatIsWrongWithAFile) {
  try {
    parse_yaml_file("/nowhere/f.yaml");
    FAIL() << "no error";
  } catch (const InputError& e) {
    EXPECT_STREQ(e.what(), "/nowhere/f.yaml: no such file");
    EXPECT_EQ(e.kind(), ErrorKind::input);
  }
  EXPECT_THROW(parse_yaml_file("/"), InputError);
  EXPECT_THROW(parse_yaml_file("/dev/zero"), InputError);  // longer than 4 MiB
}

TEST(ConfigDocument, ReadsAFileAsItsText) {
  const std::string path = testing::TempDir() + "config_document_test.yaml";
  std::ofstream(path) << "\xEF\xBB\xBF"
                         "a: 1\r\nb: 2\r\n";  // byte order mark and DOS line ends
  const Document document = parse_yaml_file(path);
  EXPECT_EQ(document.root.find("a")->text, "1");
  EXPECT_EQ(document.root.find("b")->text, "2");
  EXPECT_EQ(document.root.find("b")->at.text(), path + ":2:4");
}

TEST(ConfigDocument, TabsAndIndentationAreToldByNameWithTheirLine) {
  const auto error_of = [](const std::string& text) {
    Errors errors;
    parse_yaml_text(text, "f.yaml", errors);
    return errors.text();
  };
  EXPECT_EQ(error_of("train:\n\tn_worlds: 5\n"),
            "f.yaml:2:1: a tab before the key; YAML is indented with spaces: '<tab>n_worlds: 5'");
  EXPECT_EQ(error_of("train:\n  n_worlds: 5\n   n_threads: 3\n"),
            "f.yaml:3:4: indented by 3 spaces, the key above it by 2: the keys of a group begin in one column: '   "
            "n_threads: 3'");
  EXPECT_EQ(error_of("train:\n  n_worlds: 5\n n_threads: 3\n"),
            "f.yaml:3:2: indented by 1 space, as no key above it is: ' n_threads: 3'");
  EXPECT_EQ(error_of("mappo:\n  gamma 0.9\n  horizon: 5\n"),
            "f.yaml:2:3: a key without its colon, as in `gamma: 0.9`: '  gamma 0.9'");
  const std::string other = error_of("a: [1\nb: 2\n");
  EXPECT_NE(other.find("not valid YAML: "), std::string::npos) << other;
  EXPECT_NE(other.find("; the line: '"), std::string::npos) << other;
  // A tab elsewhere is fine: behind a value, in a comment.
  EXPECT_EQ(error_of("a: 1\t# x\n\t# y\nb: 2\n"), "");
}

TEST(ConfigDocument, AnEmptyDocumentIsNull) {
  EXPECT_TRUE(parse_yaml_text("", "f.yaml").root.is_null());
  EXPECT_TRUE(parse_yaml_text("# nothing\n", "f.yaml").root.is_null());
  EXPECT_EQ(parse_yaml_text("", "f.yaml").root.at.text(), "f.yaml:1:1");
}

TEST(ConfigOverride, ReplacesAddsAndMakesMapsOnTheWay) {
  Document document = parse_yaml_text("a: {b: 1}\n", "f.yaml");
  set_override(document, "a.b=2");
  set_override(document, "a.c.d=[3, x]");
  set_override(document, "e={f: 4}");
  set_override(document, "g=");
  set_override(document, "h=a=b");
  EXPECT_EQ(print_node(document.root), "{a: {b: 2, c: {d: [3, x]}}, e: {f: 4}, g: null, h: \"a=b\"}");
  EXPECT_EQ(document.root.find("a")->find("b")->at.text(), "--set a.b");
}

TEST(ConfigOverride, WorksOnAnEmptyDocument) {
  Document document = parse_yaml_text("", "f.yaml");
  set_override(document, "a.b=2");
  EXPECT_EQ(print_node(document.root), "{a: {b: 2}}");
}

TEST(ConfigOverride, SaysWhatIsWrong) {
  const auto error_of = [](std::string_view assignment) {
    Document document = parse_yaml_text("a: 1\nlist: [1]\n", "f.yaml");
    Errors errors;
    set_override(document, assignment, errors);
    return errors.text();
  };
  EXPECT_EQ(error_of("a"), "--set a: expected KEY=VALUE");
  EXPECT_EQ(error_of("=3"), "--set =3: expected KEY=VALUE");
  EXPECT_EQ(error_of("b..c=3"), "--set b..c: a key is missing between the dots");
  EXPECT_EQ(error_of("a.b=3"), "--set a.b: a has no keys: it is '1' (f.yaml:1:4)");
  EXPECT_EQ(error_of("list.b.c=3"), "--set list.b.c: list has no keys: it is a list (f.yaml:2:7)");
  std::string deep = "b";
  for (int k = 0; k < 50'000; ++k) deep += ".b";
  EXPECT_EQ(error_of(deep + "=3"), "--set " + deep.substr(0, 100) + "...: nested too deeply");
  EXPECT_EQ(error_of("b=[1").substr(0, 25), "--set b: not valid YAML: ");
  EXPECT_EQ(error_of("b=&x 1"), "--set b: anchors are not allowed: &x; write the value where it is needed");
}

TEST(ConfigPrint, QuotesWhatAPlainScalarWouldChange) {
  EXPECT_EQ(print_text("two_rooms1"), "two_rooms1");
  EXPECT_EQ(print_text("/some/a-b.yaml"), "/some/a-b.yaml");
  for (const char* text : {"", "none", "True", "~", "1.5", "a b", "a: b", "#x", "a\"b\\", "\xC3\xA4", "x\ny\x01"}) {
    const Document back = parse_yaml_text("k: " + print_text(text), "f.yaml");
    EXPECT_EQ(back.root.find("k")->text, text);
    EXPECT_TRUE(back.root.find("k")->quoted) << text;
  }
}

}  // namespace
}  // namespace giga
