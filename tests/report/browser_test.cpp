// The page in a real browser: every chart is drawn, pointer, zoom and controls work, nothing goes wrong.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "io/browser.hpp"
#include "io/files.hpp"
#include "report/report.hpp"
#include "synthetic_run.hpp"

namespace giga::test {
namespace {

class ReportInBrowser : public InBrowser {
 protected:
  /// Writes a run whose curves are moved by `offset`.
  void add_run(const std::string& name, int seed, const std::string& gamma, double offset) {
    SyntheticRun run;
    run.config = config_with(seed, gamma);
    run.metrics = metrics_of_a_run(offset);
    run.write(folder_ / name);
    runs_.push_back(folder_ / name);
  }

  /// What browser_check.js saw in the report of the runs.
  Document use_report(const std::string& options) {
    const std::filesystem::path page = folder_ / "report.html";
    write_report(runs_, page, {});
    return use(read_file(page), "report", "const REFERENCES = null;\n", "--window-size=1280,1600 " + options);
  }

  /// Gives a run pictures, 321 pixels wide along agent-steps, 322 along time and 323 along neither, which would change
  /// the page if they could.
  void add_ratings(const std::string& name) {
    const std::filesystem::path ratings = folder_ / name / "ratings";
    std::filesystem::create_directory(ratings);
    std::ofstream(ratings / "ratings.json") << R"({"scenario": "duel", "anchor": "random", "ratings": []})";
    for (const auto& [file, width] : {std::pair{"rating.svg", 321}, {"rating_seconds.svg", 322}, {"matrix.svg", 323}})
      std::ofstream(ratings / file) << "<svg xmlns='http://www.w3.org/2000/svg' width='" << width << "' height='9'>"
                                    << "<script>parent.problems.push('a script in a picture')</script></svg>";
  }

  std::vector<std::filesystem::path> runs_;
};

int number(const Document& seen, const char* key) { return std::stoi(text(seen, key)); }
int least(const Document& seen, const char* key) {
  int value = 1 << 30;
  for (const std::string& item : texts(seen, key)) value = std::min(value, std::stoi(item));
  return value;
}

constexpr int kLinePixels = 100;  // a line across a chart of some 500 pixels covers at least these, dashes or not

TEST_F(ReportInBrowser, SeedsOfOneConfig) {
  for (int seed = 1; seed <= 3; ++seed) add_run("s" + std::to_string(seed), seed, "0.99", 0.1 * (seed - 1));
  const Document seen = use_report("");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(texts(seen, "requests"), Texts());
  // Win rate; games won, return, episode length; entropy, KL, explained variance, two losses; rewards; speed, seconds.
  EXPECT_EQ(number(seen, "charts"), 1 + 3 + 5 + 1 + 2);
  EXPECT_EQ(number(seen, "charts_unfolded"), 12 + 1);  // mutual information
  EXPECT_GE(least(seen, "unfolded_pixels"), kLinePixels);
  EXPECT_TRUE(contains(text(seen, "text"), {"mean of 3 seeds; band: smallest to largest", "1, 2, 3"}));
  // Entropy of team 0 after update 60: 3 - 60 x 0.02 + 0, 0.1 and 0.2. The pointer is in the middle of 1k to 120k.
  ASSERT_EQ(texts(seen, "hover_at").size(), 1u) << "the pointer is in the same place in all charts";
  EXPECT_TRUE(texts(seen, "hover_at")[0] == "at 60k agent-steps" || texts(seen, "hover_at")[0] == "at 61k agent-steps");
  EXPECT_TRUE(text(seen, "hover_value") == "1.9 1.8 to 2" || text(seen, "hover_value") == "1.88 1.78 to 1.98");
}

TEST_F(ReportInBrowser, ZoomAxisAndNames) {
  add_run("only", 1, "0.99", 0);
  add_ratings("only");
  const Document seen = use_report("");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_GE(least(seen, "line_pixels"), kLinePixels);
  EXPECT_EQ(texts(seen, "full_range"), Texts{"[1000,120000]"});
  // Steps of 20k for a range of 119k, of 10k for 59.5k; the first ones come drawn, the last ones are the script's.
  const Texts full = {"20k 40k 60k 80k 100k 120k"}, zoomed = {"40k 50k 60k 70k 80k 90k"};
  EXPECT_EQ(texts(seen, "full_labels"), full);
  EXPECT_EQ(texts(seen, "zoomed_labels"), zoomed) << "all charts zoom together";
  EXPECT_EQ(texts(seen, "unzoomed_labels"), full);
  EXPECT_EQ(texts(seen, "seconds_labels"), Texts{"0:10 0:20 0:30 0:40 0:50 1:00"});
  // From a quarter to three quarters of 1000 to 120000: 30750 to 90250, to a pixel (119000 / 450 = 264).
  int from = 0, to = 0;
  ASSERT_EQ(std::sscanf(texts(seen, "zoomed_range")[0].c_str(), "[%d,%d]", &from, &to), 2);
  EXPECT_NEAR(from, 30750, 600);
  EXPECT_NEAR(to, 90250, 600);
  EXPECT_EQ(text(seen, "reset_shown"), "true");
  EXPECT_EQ(texts(seen, "unzoomed_range"), texts(seen, "full_range"));
  EXPECT_EQ(texts(seen, "seconds_range"), Texts{"[1,60]"});  // 0.5 s to 60 s, rounded
  EXPECT_EQ(text(seen, "smoothing"), "mean of 7 points");
  EXPECT_GE(number(seen, "pixels_before"), kLinePixels);
  EXPECT_EQ(number(seen, "pixels_hidden"), 0);
  EXPECT_EQ(texts(seen, "pictures"), (Texts{"321", "323"}));
  EXPECT_EQ(texts(seen, "seconds_pictures"), (Texts{"322", "323"}));
}

TEST_F(ReportInBrowser, DarkAndSeveralConfigs) {
  add_run("a", 1, "0.99", 0);
  add_run("b", 2, "0.99", 0.05);
  add_run("c", 1, "0.9", 0.2);
  add_run("<b id=evil>d", 1, "\"</script><b id=evil>\"", 0.3);
  const Document seen = use_report("--blink-settings=preferredColorScheme=0");
  EXPECT_EQ(texts(seen, "problems"), Texts());
  EXPECT_EQ(text(seen, "ground"), "rgb(18, 21, 27)");           // --ground of the dark theme, #12151b
  EXPECT_EQ(text(seen, "other_ground"), "rgb(246, 247, 249)");  // of the light one, #f6f7f9
  EXPECT_GE(least(seen, "line_pixels"), kLinePixels);
  EXPECT_GE(number(seen, "other_pixels"), kLinePixels);
  EXPECT_EQ(number(seen, "injected"), 0);
  EXPECT_TRUE(contains(text(seen, "text"), {"3 configurations compared", "gamma=0.99", "gamma=0.9", "What differs"}));
}

}  // namespace
}  // namespace giga::test
