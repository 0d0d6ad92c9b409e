// What io writes as text: numbers, JSON, metrics.csv, log, progress.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <nlohmann/json.hpp>

#include "config/document.hpp"
#include "io/files.hpp"
#include "io/host_info.hpp"
#include "io/json.hpp"
#include "io/logger.hpp"
#include "io/metrics_csv.hpp"
#include "io/number.hpp"
#include "io/progress.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Number, ReadsBackToTheSameValue) {
  for (const double x : {0.1, -1.0 / 3, 1e-300, 3e8, 9007199254740993.0, 5e-324, -0.0, 1.7976931348623157e308})
    EXPECT_EQ(std::strtod(print_number(x).c_str(), nullptr), x) << print_number(x);
  EXPECT_EQ(print_number(300'000'000), "300000000");
  EXPECT_EQ(print_number(-0.0), "-0");
  EXPECT_EQ(print_number(0.5), "0.5");
}

TEST(Number, ForPeople) {
  EXPECT_EQ(print_short(950), "950");
  EXPECT_EQ(print_short(999.9), "1.00 k");
  EXPECT_EQ(print_short(12'345'678), "12.3 M");
  EXPECT_EQ(print_short(5.04e9), "5.04 G");
  EXPECT_EQ(print_duration(3723), "1:02:03");
  EXPECT_EQ(print_duration(59.6), "1:00");
  EXPECT_EQ(print_duration(kNan), "-:--");
}

TEST(JsonText, ObjectsKeepTheirOrder) {
  const Json json{{"z", 1},       {"a", {0.5, kNan, 3.0}}, {"e", Json::object()},
                  {"n", nullptr}, {"none", Json::array()}, {"list", Json::array({{{"x", true}}})}};
  EXPECT_EQ(json_text(json),
            "{\n  \"z\": 1,\n  \"a\": [0.5, null, 3],\n  \"e\": {},\n  \"n\": null,\n  \"none\": [],\n"
            "  \"list\": [\n    {\n      \"x\": true\n    }\n  ]\n}");
}

TEST(JsonText, OfWhatWasRead) {
  const Json json{{"text", "7"},     {"number", -0.25}, {"count", 12},
                  {"none", nullptr}, {"yes", true},     {"no", false},
                  {"empty", ""},     {"word", "null"},  {"list", Json::array({{{"x", {1e300, kNan}}}})}};
  EXPECT_EQ(json_text(json_of(parse_yaml_text(json_text(json), "json").root)), json_text(json));
}

TEST(JsonText, Numbers) {
  EXPECT_EQ(json_text(std::numeric_limits<uint64_t>::max()), "18446744073709551615");
  EXPECT_EQ(json_text(std::numeric_limits<int64_t>::min()), "-9223372036854775808");
  EXPECT_EQ(json_text(int8_t{-3}), "-3");
  EXPECT_EQ(json_text(0.1), "0.1");
  EXPECT_EQ(json_text(3e8), "300000000");
}

// JSON is YAML: the project's own reader serves as the check.
TEST(JsonText, StringsAreEscaped) {
  EXPECT_EQ(json_text("a\"b\\c\n\t\x01"), "\"a\\\"b\\\\c\\n\\t\\u0001\"");
  EXPECT_EQ(json_text("größe €"), "\"größe €\"");
  EXPECT_EQ(json_text("\xff\xc0\x80"), "\"\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\"");  // not UTF-8
  const std::string text = "quotes \" and \\ and\nlines: [1, 2] # no comment";
  const Document document = parse_yaml_text(json_text({{"key", text}}), "json");
  EXPECT_EQ(document.root.find("key")->text, text);
}

TEST(MetricsFile, HeaderRowsAndUnknownFigures) {
  const TemporaryFolder folder;
  MetricsCsv csv(folder / "m.csv");
  csv.write({{"update", 1}, {"a_b", 0.25}, {"loss", kNan}});
  EXPECT_EQ(read_file(folder / "m.csv"), "update,a_b,loss\r\n1,0.25,\r\n") << "not flushed after the row";
  csv.write({{"update", 2}, {"a_b", 1e-9}, {"loss", -INFINITY}});
  EXPECT_TRUE(contains(read_file(folder / "m.csv"), {"\r\n2,1e-09,-inf\r\n"}));
  EXPECT_THROW(csv.write({{"up,date", 3}, {"a_b", 1}, {"loss", 1}}), Error) << "a name that would make two columns";
}

TEST(MetricsFile, GoesOnWhereACheckpointWasWritten) {
  const TemporaryFolder folder;
  uint64_t size = 0;
  {
    MetricsCsv csv(folder / "m.csv");
    csv.write({{"update", 1}, {"loss", 5}});
    size = csv.size();
    csv.write({{"update", 2}, {"loss", 4}});
    csv.write({{"update", 3}, {"loss", 3}});
  }
  {
    MetricsCsv csv(folder / "m.csv", size);
    EXPECT_EQ(read_file(folder / "m.csv"), "update,loss\r\n1,5\r\n");
    EXPECT_TRUE(contains(input_error_of([&] {
                           csv.write({{"update", 2}, {"other", 4}});
                         }),
                         {"m.csv: column 2 is loss where this gigastep writes other"}));
    csv.write({{"update", 2}, {"loss", 4.5}});
  }
  EXPECT_EQ(read_file(folder / "m.csv"), "update,loss\r\n1,5\r\n2,4.5\r\n");
  EXPECT_TRUE(contains(input_error_of([&] { MetricsCsv(folder / "m.csv", 1000); }), {"m.csv", "has 25 bytes", "1000"}));
  EXPECT_TRUE(contains(input_error_of([&] { MetricsCsv(folder / "none.csv", 0); }), {"none.csv", "No such file"}));
  EXPECT_TRUE(contains(input_error_of([&] { MetricsCsv::expect(folder / "m.csv", 1000); }), {"1000", "move it away"}));
  EXPECT_TRUE(contains(input_error_of([&] { MetricsCsv::expect(folder / "m.csv", 24); }),
                       {"no row ends at byte 24", "move it away"}));
  EXPECT_NO_THROW(MetricsCsv::expect(folder / "m.csv", 25));
  EXPECT_NO_THROW(MetricsCsv::expect(folder / "none.csv", 25)) << "it is begun anew";
}

TEST(MetricsFile, ColumnsNeverChange) {
  const TemporaryFolder folder;
  MetricsCsv csv(folder / "m.csv");
  csv.write({{"update", 1}, {"loss", 2}});
  EXPECT_THROW(csv.write({{"update", 2}, {"other", 2}}), Error);
  EXPECT_THROW(csv.write({{"update", 2}}), Error);
  EXPECT_THROW(csv.write({{"update", 2}, {"loss", 1}, {"more", 1}}), Error);
  EXPECT_EQ(read_file(folder / "m.csv"), "update,loss\r\n1,2\r\n");
  EXPECT_THROW(MetricsCsv(folder / "m.csv"), Error) << "overwrites";
}

TEST(Log, MessagesAreNoFormatStrings) {
  const TemporaryFolder folder;
  ::testing::internal::CaptureStderr();
  {
    Logger log(folder / "log.txt", Logger::Console::all);
    log.info("braces {} and %s");
    log.warn("careful");
    log.note("for the file");
    log.error("the end");
  }
  const std::string console = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(console, "braces {} and %s\nwarning: careful\n");
  EXPECT_TRUE(contains(read_file(folder / "log.txt"), {" info: braces {} and %s\n", " warning: careful\n",
                                                       " info: for the file\n", " error: the end\n"}));
}

TEST(Log, Quiet) {
  const TemporaryFolder folder;
  ::testing::internal::CaptureStderr();
  {
    Logger log(folder / "log.txt", Logger::Console::quiet);
    log.info("unheard");
    log.warn("heard");
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "warning: heard\n");
  EXPECT_TRUE(contains(read_file(folder / "log.txt"), {"unheard"}));
}

ProgressState quarter_done() {
  ProgressState s;
  s.update = 5;
  s.n_updates = 20;
  s.agent_steps = 250'000;
  s.total_agent_steps = 1'000'000;
  s.agent_steps_per_second = 25'000;
  s.seconds_left = 30;
  return s;
}

TEST(ProgressLine, SaysHowFarItIs) {
  ProgressState s = quarter_done();
  EXPECT_EQ(progress_text(s), "update 5 of 20: 250 k of 1.00 M agent-steps, 25.0 k/s, 0:30 left");
  s.team[0].mean_return = 12.25;
  s.team[0].win_rates = {{"random", 0.98}, {"circle", 0.4}};
  s.team[1].win_rates = {{"random", 0.97}};
  EXPECT_EQ(progress_text(s),
            "update 5 of 20: 250 k of 1.00 M agent-steps, 25.0 k/s, 0:30 left, return 12.2, "
            "wins vs random 0.98/0.97 circle 0.40");
  s.team[1].mean_return = -3;
  EXPECT_TRUE(contains(progress_text(s), {"return 12.2/-3, "}));
}

TEST(ProgressLine, PlainLinesComeAtACadence) {
  const TemporaryFolder folder;
  ::testing::internal::CaptureStderr();
  {
    Logger log(folder / "log.txt", Logger::Console::all);
    Progress progress(log, Progress::Mode::lines, std::chrono::hours(1));
    ProgressState state = quarter_done();
    for (state.update = 1; state.update <= state.n_updates; ++state.update) progress.show(state);
  }
  const std::string lines = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(lines.begin(), lines.end(), '\n'), 2) << "the first and the last:\n" << lines;
  EXPECT_EQ(lines.find('\x1b'), std::string::npos) << "an escape sequence in a plain line";
}

TEST(ProgressLine, QuietWritesToTheFileAlone) {
  const TemporaryFolder folder;
  ::testing::internal::CaptureStderr();
  {
    Logger log(folder / "log.txt", Logger::Console::quiet);
    Progress progress(log, Progress::Mode::off);
    progress.show(quarter_done());
    progress.finish();
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  EXPECT_TRUE(contains(read_file(folder / "log.txt"), {"update 5 of 20: 250 k of 1.00 M agent-steps"}));
}

TEST(HostFacts, AreThere) {
  const HostInfo host = host_info();
  EXPECT_GE(host.cores, 1);
  EXPECT_GT(host.memory_bytes, 1 << 20);
  EXPECT_GT(resident_bytes(), 1 << 16);
  EXPECT_EQ(utc_now().size(), std::string("2026-11-21T12:53:18Z").size());
}

}  // namespace
}  // namespace giga::test
