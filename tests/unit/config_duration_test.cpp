// Durations in YAML: read, printed, refused.
#include "config/duration.hpp"

#include <gtest/gtest.h>

namespace giga::test {
namespace {

struct Holder {
  std::optional<Duration> limit;
};
template <class V>
void visit_fields(V& v, Holder& c) {
  v("limit", c.limit, "how long");
}

/// Seconds of a text; -1 where it is refused.
double seconds(const std::string& text) {
  Holder holder;
  Errors errors;
  read_fields(parse_yaml_text("limit: " + text + "\n", "t").root, holder, errors);
  return errors.empty() ? holder.limit->seconds : -1;
}

TEST(ConfigDuration, UnitsAddUp) {
  EXPECT_EQ(seconds("90s"), 90);
  EXPECT_EQ(seconds("3h30m"), 3 * 3600 + 30 * 60);
  EXPECT_EQ(seconds("1d2h3m4s"), 86400 + 2 * 3600 + 3 * 60 + 4);
  EXPECT_EQ(seconds("100h"), 360000);
}

TEST(ConfigDuration, EverythingElseIsRefused) {
  for (const char* text : {"3", "h", "3x", "30m3h", "1h1h", "-1h", "0s", "1.5h", "1 h", "''", "[1h]", "99999999999999d",
                           "1h99999999999999999999s", "3hours"})
    EXPECT_EQ(seconds(text), -1) << text;
}

TEST(ConfigDuration, PrintsWhatReadsBack) {
  for (const char* text : {"1s", "59m", "1d", "3h30m", "1d2h3m4s"}) {
    Holder holder{Duration{seconds(text)}};
    EXPECT_EQ(print_yaml(holder, false), std::string("limit: ") + text + "\n");
  }
  EXPECT_EQ(print_yaml(Holder{Duration{90}}, false), "limit: 1m30s\n");
  EXPECT_EQ(print_yaml(Holder{}, false), "limit: none\n");
}

}  // namespace
}  // namespace giga::test
