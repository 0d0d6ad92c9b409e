// The pages and examples that users follow: every command of the tutorial runs, every config is good, every column of
// metrics.csv is explained, and an exported policy gives the same numbers in Python and in C++.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <regex>
#include <set>
#include <sstream>

#include "io/files.hpp"
#include "program.hpp"
#include "runs.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {
namespace fs = std::filesystem;

/// The blocks of a page that are commands.
std::vector<std::string> shell_blocks(const std::string& page) {
  const std::string start = "```sh\n", end = "```";
  std::vector<std::string> blocks;
  for (size_t at = 0; (at = page.find(start, at)) != std::string::npos;) {
    at += start.size();
    const size_t stop = page.find(end, at);
    blocks.push_back(page.substr(at, stop - at));
    at = stop + end.size();
  }
  return blocks;
}

std::string with(const std::string& text, const char* pattern, const char* replacement) {
  EXPECT_TRUE(std::regex_search(text, std::regex(pattern))) << pattern;
  return std::regex_replace(text, std::regex(pattern), replacement);
}

/// A folder that looks like the project's to the commands of a page: scripts/run, examples/. Each call of scripts/run
/// leaves a line in the file `times`: its seconds and its arguments.
class Project {
 public:
  Project() {
    here_.write("scripts/run", "#!/bin/sh\nbegan=$(date +%s%N)\n'" + kGigastep +
                                   "' \"$@\"\ncode=$?\nmilliseconds=$((($(date +%s%N) - began) / 1000000))\n"
                                   "printf '%d.%d s  scripts/run %s\\n' $((milliseconds / 1000)) "
                                   "$((milliseconds / 100 % 10)) \"$*\" >>'" +
                                   (here_.path() / "times").string() + "'\nexit $code\n");
    fs::permissions(here_.path() / "scripts/run", fs::perms::owner_all);
    fs::create_directory_symlink(source_path("examples"), here_.path() / "examples");
    fs::create_directories(here_.path() / "data");
    fs::create_directory_symlink(source_path("scenarios"), here_.path() / "data/scenarios");
  }
  const Workplace& here() const { return here_; }
  Outcome shell(const std::string& commands, const Environment& environment = {}) const {
    return here_.run({"-e", "-c", commands}, "/bin/sh", environment);
  }

 private:
  Workplace here_;
};

TEST(FirstHour, EveryCommandRuns) {
  const Project project;
  const Workplace& here = project.here();
  std::string page = read_file(source_path("docs/first_hour.md"));
  Environment environment;
  if (thinned(100) > 1) {
    // The same commands with tiny runs, of one seed where there are three: 32 worlds x 32 steps x 10 agents are 10,240
    // agent-steps in an update.
    page = with(page, "train.total_agent_steps=[0-9e]+", "train.total_agent_steps=12000");
    page = with(page, "for seed in 1 2 3;", "for seed in 1;");
    std::string quickstart = read_file(source_path("configs/quickstart.yaml"));
    quickstart = with(with(quickstart, "n_worlds: [0-9_]+", "n_worlds: 32"), "episodes: [0-9]+", "episodes: 8");
    here.write("data/configs/quickstart.yaml", quickstart);
    environment.emplace_back("GIGASTEP_DATA_DIR", (here.path() / "data").string());
  }
  const std::string python = python_with("numpy, safetensors");
  int n_commands = 0;
  for (std::string block : shell_blocks(page)) {
    if (block.find("python3") != std::string::npos) {
      if (python.empty()) {
        std::cout << "no Python with numpy and safetensors: left out\n" << block;
        continue;
      }
      block = with(block, "python3", ("'" + python + "'").c_str());
    }
    const Outcome outcome = project.shell(block, environment);
    ASSERT_EQ(outcome.code, 0) << block << outcome.out << outcome.err;
    ++n_commands;
  }
  EXPECT_GE(n_commands, 7);
  for (const char* made : {"runs/first/report.html", "runs/damage.html", "mine/pass_resolved.yaml", "runs/rates.html",
                           "runs/ratings/rating.svg", "mine/fighter/manifest.json"})
    EXPECT_TRUE(here.has(made)) << made;
  // What was stopped went on to its end, as the run of the same length did that was not.
  EXPECT_EQ(metrics_rows(here, "runs/stopped"), metrics_rows(here, "runs/first"));
  if (tests_run_in_full()) std::cout << here.read("times");  // for docs/measurements.md
}

TEST(Examples, EveryConfigIsGood) {
  const Project project;
  int n = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(source_path("examples"))) {
    if (entry.path().extension() != ".yaml") continue;
    const std::string name = entry.path().filename().string();
    const Outcome outcome = project.shell("cd examples && '" + kGigastep + "' config " + name);
    EXPECT_EQ(outcome.code, 0) << name << outcome.err;
    EXPECT_NE(read_file(source_path("examples/README.md")).find("(" + name + ")"), std::string::npos)
        << name << " is not in examples/README.md";
    ++n;
  }
  EXPECT_GE(n, 5);
}

TEST(Examples, AnExportedPolicyGivesTheSameNumbersInPythonAndCpp) {
  if (!tests_run_in_full()) GTEST_SKIP() << "compiles for ten seconds; run with GIGASTEP_TEST_FULL=1";
  const Project project;
  project.here().write("short.yaml", kShortConfig);
  const Outcome made = project.shell(
      "scripts/run train short.yaml --run-dir run --quiet --set environment.observation.egocentric_view=true\n"
      "scripts/run export run --team 0 --format safetensors --view input --out policy\n"
      "scripts/run export run --team 0 --format safetensors --out alone\n"
      "c++ -std=c++20 examples/use_policy.cpp -o use_policy\n");
  ASSERT_EQ(made.code, 0) << made.err;
  const Outcome cpp = project.shell("./use_policy policy");
  ASSERT_EQ(cpp.code, 0) << cpp.err;
  EXPECT_TRUE(contains(cpp.out, {"action: ", "\"throttle\":", "head: "}));
  EXPECT_NE(project.shell("./use_policy nowhere").code, 0);
  EXPECT_TRUE(contains(project.shell("./use_policy alone").err, {"export with --view input"}));

  const std::string python = python_with("numpy, safetensors");
  if (python.empty()) GTEST_SKIP() << "no Python with numpy and safetensors: scripts/bootstrap --dev installs them";
  const Outcome other = project.shell("'" + python + "' examples/use_policy.py policy");
  ASSERT_EQ(other.code, 0) << other.err;
  const auto head_of = [](const std::string& out) { return out.substr(std::min(out.find("head: "), out.size())); };
  EXPECT_EQ(head_of(cpp.out), head_of(other.out));
}

/// A column as the page of training writes it: return_0 is `return_T`, win_rate_1_vs_random is `win_rate_T_vs_O`.
std::string name_on_the_page(const std::string& column) {
  const std::string of_team = std::regex_replace(column, std::regex("_[01]($|_vs_)"), "_T$1");
  const std::string of_script = std::regex_replace(of_team, std::regex("_vs_.*"), "_vs_O");
  return std::regex_replace(of_script, std::regex("^reward_.*_T$"), "reward_TERM_T");
}

/// The columns of a run of a config that the page does not explain.
std::set<std::string> unexplained(const std::string& config) {
  const std::string page = read_file(source_path("docs/training.md"));
  const Workplace here;
  here.write("run.yaml", config);
  const Outcome outcome = here.run({"train", "run.yaml", "--run-dir", "run", "--quiet"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  std::set<std::string> missing;
  const auto explain = [&](const std::string& what, const std::string& column) {
    if (page.find(what) == std::string::npos) missing.insert(column);
  };
  for (const std::string& column : parse_csv(here.read("run/metrics.csv")).columns) {
    const std::string name = name_on_the_page(column);
    explain("\n| `" + name + "` |", column);
    if (name == "reward_TERM_T") explain("`" + column.substr(7, column.size() - 9) + "`", column);
  }
  return missing;
}

TEST(TrainingPage, ExplainsEveryColumnOfMappo) {
  EXPECT_EQ(unexplained(std::string(kShortConfig) + "opponents: {pool_size: 2, pool_every_updates: 1}\n"),
            std::set<std::string>{});
}

TEST(TrainingPage, ExplainsEveryColumnOfEvolution) {
  EXPECT_EQ(unexplained(R"(scenario: identical_1_vs_1_fobs_vec_void_disc
device: cpu
train: {algorithm: snes, total_agent_steps: 500, n_threads: 1}
population: {population_size: 4, episodes_per_member: 2, max_steps: 20, actor: {hidden: [8]}}
eval: {episodes: 8, every_updates: 2, opponents: [random]}
)"),
            std::set<std::string>{});
}

TEST(Pages, PicturesOfTheGameAreCurrent) {
  const std::string python = python_with("sys");
  if (python.empty()) GTEST_SKIP() << "no Python";
  const Project project;
  fs::copy_file(source_path("scripts/pictures"), project.here().path() / "scripts/pictures");
  const Outcome drawn = project.shell("'" + python + "' scripts/pictures game", {{"GIGASTEP", kGigastep}});
  ASSERT_EQ(drawn.code, 0) << drawn.err;
  int n = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(project.here().path() / "docs/pictures")) {
    const std::string name = "docs/pictures/" + entry.path().filename().string();
    EXPECT_EQ(project.here().read(name), read_file(source_path(name)))
        << name << ": scripts/pictures game draws it anew";
    ++n;
  }
  EXPECT_GE(n, 6);  // four maps, cones, a start
}

/// The anchors of a page's headings, as the usual viewers of Markdown make them.
std::set<std::string> anchors_of(const fs::path& page) {
  std::set<std::string> anchors;
  std::istringstream lines(read_file(page));
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with("#")) continue;
    std::string anchor;
    for (const char c : line.substr(std::min(line.find_first_not_of("# "), line.size()))) {
      const auto byte = static_cast<unsigned char>(c);
      if (std::isalnum(byte) || c == '_' || c == '-') anchor += static_cast<char>(std::tolower(byte));
      if (c == ' ') anchor += '-';
    }
    anchors.insert(anchor);
  }
  return anchors;
}

// Which configs the page of the game names as those without the egocentric view, or with rewards of their own.
TEST(Pages, WhatShippedConfigsReadAndPay) {
  const std::string page = read_file(source_path("docs/game.md"));
  std::string other_inputs, no_damage;
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(source_path("configs"))) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    const std::string text = read_file(file), name = " `" + file.stem().string() + "`";
    if (text.find("inputs: egocentric") == std::string::npos) other_inputs += name;
    if (text.find("damage: 50") == std::string::npos) no_damage += name;
  }
  EXPECT_EQ(other_inputs, " `pixels` `published` `published_corrected`");
  EXPECT_EQ(no_damage, " `memory` `published` `published_corrected`");
  EXPECT_TRUE(contains(page, {"but `pixels`, `published` and `published_corrected`",
                              "`published` and\n`published_corrected` keep the original's rewards, `memory` those"}));
}

TEST(Pages, LinksLeadSomewhere) {
  const std::regex link(R"(\]\(([^)#:]*)(#[^)]*)?\))");
  int n = 0;
  for (const char* folder : {".", "docs", "examples"})
    for (const fs::directory_entry& entry : fs::directory_iterator(source_path(folder))) {
      if (entry.path().extension() != ".md") continue;
      const std::string page = read_file(entry.path());
      for (std::sregex_iterator at(page.begin(), page.end(), link), end; at != end; ++at, ++n) {
        const std::string file = (*at)[1], anchor = (*at)[2];
        const fs::path target = file.empty() ? entry.path() : entry.path().parent_path() / file;
        ASSERT_TRUE(fs::exists(target)) << entry.path().filename() << ": " << at->str();
        EXPECT_TRUE(anchor.empty() || anchors_of(target).contains(anchor.substr(1)))
            << entry.path().filename() << ": " << at->str();
      }
    }
  EXPECT_GT(n, 50);
}

}  // namespace
}  // namespace giga::test
