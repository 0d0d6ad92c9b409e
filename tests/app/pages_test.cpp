// The pages and examples that users follow: every command of the tutorial runs, every config is good, every column of
// metrics.csv is explained, and an exported policy gives the same numbers in Python and in C++.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstdlib>
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

/// A block of a page that is commands, and the heading above it.
struct ShellBlock {
  std::string heading, commands;
};
std::vector<ShellBlock> shell_blocks(const std::string& page) {
  std::vector<ShellBlock> blocks;
  std::string heading;
  bool inside = false;
  std::istringstream lines(page);
  for (std::string line; std::getline(lines, line);) {
    if (inside && line != "```") blocks.back().commands += line + "\n";
    if (!inside && line.starts_with("#")) heading = line.substr(line.find(' ') + 1);
    if (!inside && line == "```sh") blocks.push_back({heading, ""});
    inside = line == "```sh" || (inside && line != "```");
  }
  return blocks;
}

std::string with(const std::string& text, const char* pattern, const char* replacement) {
  EXPECT_TRUE(std::regex_search(text, std::regex(pattern))) << pattern;
  return std::regex_replace(text, std::regex(pattern), replacement);
}

/// A command of a page as it ran.
struct Call {
  std::string command, seconds, code, out, err;
};

/// A folder that looks like the project's to the commands of a page: scripts/run, examples/. What is called by
/// scripts/run, and by ./python3 where there is one, is noted.
class Project {
 public:
  Project() {
    fs::create_directories(calls_path());
    write_noting("scripts/run", kGigastep);
    fs::create_directory_symlink(source_path("examples"), here_.path() / "examples");
    fs::create_directories(here_.path() / "data");
    fs::create_directory_symlink(source_path("scenarios"), here_.path() / "data/scenarios");
  }
  void add_python(const std::string& python) const { write_noting("python3", python); }
  const Workplace& here() const { return here_; }
  Outcome shell(const std::string& commands, const Environment& environment = {}) const {
    return here_.run({"-e", "-c", commands}, "/bin/sh", environment);
  }
  /// Takes the calls since the last time.
  std::vector<Call> take_calls() const {
    std::vector<Call> calls;
    for (;; ++n_taken_) {
      const std::string stem = (calls_path() / std::to_string(n_taken_)).string();
      if (!fs::exists(stem + ".code")) return calls;
      const auto part = [&](const char* ending) { return read_file(stem + ending); };
      calls.push_back({part(".command"), part(".seconds"), part(".code"), part(".out"), part(".err")});
    }
  }

 private:
  fs::path calls_path() const { return here_.path() / "calls"; }
  void write_noting(const std::string& name, const std::string& program) const {
    here_.write(name, "#!/bin/sh\ncalls='" + calls_path().string() +
                          "'\nstem=$calls/$(ls $calls | grep -c code)\nbegan=$(date +%s%N)\n'" + program +
                          "' \"$@\" >$stem.out 2>$stem.err\ncode=$?\ntenths=$((($(date +%s%N) - began) / 100000000))\n"
                          "printf '" +
                          name +
                          "' >$stem.command\nfor word; do case $word in\n"
                          "*[!A-Za-z0-9_./=,:+-]*) printf \" '%s'\" \"$word\" ;; *) printf ' %s' \"$word\" ;;\n"
                          "esac >>$stem.command; done\n"
                          "printf '%d.%d' $((tenths / 10)) $((tenths % 10)) >$stem.seconds\n"
                          "printf '%d' $code >$stem.code\ncat $stem.out\ncat $stem.err >&2\nexit $code\n");
    fs::permissions(here_.path() / name, fs::perms::owner_all);
  }

  Workplace here_;
  mutable int n_taken_ = 0;
};

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

/// The first lines and the last of what a call printed, as a user in the project's folder sees it.
std::string shortened(const Call& call, const Project& project) {
  constexpr size_t kFirst = 3, kLast = 7;
  std::string text = call.err + call.out;
  replace_all(text, kGigastep, "./build/release/bin/gigastep");
  replace_all(text, project.here().path().string() + "/", "");
  std::vector<std::string> lines;
  std::istringstream all(text);
  for (std::string line; std::getline(all, line);) lines.push_back(line.substr(0, line.find_last_not_of(' ') + 1));
  std::string result;
  for (size_t k = 0; k < lines.size(); ++k) {
    if (k == kFirst && lines.size() > kFirst + kLast + 1) {
      result += "[... " + std::to_string(lines.size() - kFirst - kLast) + " lines]\n";
      k = lines.size() - kLast;
    }
    result += lines[k] + "\n";
  }
  return result;
}

std::string load_average() { return read_file("/proc/loadavg").substr(0, read_file("/proc/loadavg").find(' ')); }

/// "scripts/run train".
std::string first_words(const std::string& command) {
  return command.substr(0, command.find(' ', command.find(' ') + 1));
}

/// docs/first_hour_transcript.md.
class Transcript {
 public:
  /// The calls of a block. Of those that a loop makes the first one's output stands for all.
  void add(const std::string& heading, const std::vector<Call>& calls, const Project& project) {
    for (size_t k = 0; k < calls.size(); ++k) {
      const Call& call = calls[k];
      const bool again = k > 0 && first_words(call.command) == first_words(calls[k - 1].command);
      commands_.push_back(call.command);
      seconds_ += std::stod(call.seconds);
      if (heading != heading_) body_ += "\n## " + heading + "\n";
      heading_ = heading;
      body_ += "\n" + call.seconds + " s" + (call.code == "0" ? "" : ", exit code " + call.code) + "\n\n```text\n$ " +
               call.command + "\n" + (again ? "[the like]\n" : shortened(call, project)) + "```\n";
    }
  }
  /// `run`: the run.json of one of its runs.
  std::string page(const std::string& run) const {
    const Document info = parse_yaml_text(run, "run.json");
    const bool clean = at(info, {"versions", "clean_tree"}).text == "true";
    char total[32];
    std::snprintf(total, sizeof total, "%.0f", seconds_);
    return "# The first hour: a transcript\n\n"
           "What the commands of [the first hour](first_hour.md) print, and how long each takes. A test ran\n"
           "them one after the other, the program being built, and wrote this page:\n\n"
           "```sh\nGIGASTEP_WRITE_DOCS=1 GIGASTEP_TEST_FULL=1 build/release/bin/test_app \\\n"
           "  --gtest_filter='FirstHour.*'\n```\n\n"
           "All together took **" +
           std::string(total) +
           " s**.\n\n"
           "| | |\n|---|---|\n"
           "| commit | " +
           at(info, {"versions", "commit"}).text + (clean ? "" : ", with changes") + " |\n" + "| processor | " +
           at(info, {"hardware", "cpu"}).text + ", " + at(info, {"hardware", "cores"}).text +
           " cores; no GPU is used |\n" + "| load of the machine | " + load_before_ + " before, " + load_average() +
           " after (mean of a minute, processes) |\n\n"
           "Of long outputs the first and the last lines are shown, and of a loop the output of its first run;\n"
           "progress comes before results. [At the end](#what-the-pages-look-like): pictures of the pages.\n" +
           body_ +
           "\n## What the pages look like\n\n"
           "As `scripts/pictures` draws them: [the README](pictures/readme.png) and [the page of the\n"
           "game](pictures/game_page.png) as a viewer of Markdown shows them, [a report](pictures/report.png),\n"
           "[a replay](pictures/replay.png), [the page of play](pictures/play.png), and [the panel of a\n"
           "run](pictures/panel.svg) in a terminal.\n";
  }
  /// The commands, and those of a page that was written before.
  const std::vector<std::string>& commands() const { return commands_; }
  static std::vector<std::string> commands_of(const std::string& page) {
    std::vector<std::string> commands;
    std::istringstream lines(page);
    for (std::string line; std::getline(lines, line);)
      if (line.starts_with("$ ")) commands.push_back(line.substr(2));
    return commands;
  }

 private:
  std::string heading_, body_;
  const std::string load_before_ = load_average();
  std::vector<std::string> commands_;
  double seconds_ = 0;
};

TEST(FirstHour, EveryCommandRuns) {
  const Project project;
  const Workplace& here = project.here();
  std::string page = read_file(source_path("docs/first_hour.md"));
  Environment environment;
  const bool in_full = thinned(100) == 1;
  if (!in_full) {
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
  if (!python.empty()) project.add_python(python);
  Transcript transcript;
  int n_commands = 0;
  for (auto [heading, commands] : shell_blocks(page)) {
    if (commands.find("python3") != std::string::npos) {
      if (python.empty()) {
        std::cout << "no Python with numpy and safetensors: left out\n" << commands;
        continue;
      }
      commands = with(commands, "python3", "./python3");
    }
    const Outcome outcome = project.shell(commands, environment);
    ASSERT_EQ(outcome.code, 0) << commands << outcome.out << outcome.err;
    transcript.add(heading, project.take_calls(), project);
    ++n_commands;
  }
  EXPECT_GE(n_commands, 7);
  for (const char* made : {"runs/first/report.html", "runs/damage.html", "mine/pass_resolved.yaml", "runs/rates.html",
                           "runs/ratings/rating.svg", "mine/fighter/manifest.json"})
    EXPECT_TRUE(here.has(made)) << made;
  // What was stopped went on to its end, as the run of the same length did that was not.
  EXPECT_EQ(metrics_rows(here, "runs/stopped"), metrics_rows(here, "runs/first"));
  if (!in_full || python.empty()) return;
  const std::string file = source_path("docs/first_hour_transcript.md");
  if (std::getenv("GIGASTEP_WRITE_DOCS")) write_file(file, transcript.page(here.read("runs/first/run.json")));
  EXPECT_EQ(Transcript::commands_of(read_file(file)), transcript.commands())
      << "the page is of other commands: GIGASTEP_WRITE_DOCS=1 writes it anew";
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
  const std::string of_factor = std::regex_replace(of_script, std::regex("^shaping_factor_.+"), "shaping_factor_TERM");
  return std::regex_replace(of_factor, std::regex("^reward_.*_T$"), "reward_TERM_T");
}

/// The columns of a run of a config that the page does not explain.
std::set<std::string> unexplained(const std::string& config, const std::vector<std::string>& settings = {}) {
  const std::string page = read_file(source_path("docs/training.md"));
  const Workplace here;
  here.write("run.yaml", config);
  std::vector<std::string> words = {"train", "run.yaml", "--run-dir", "run", "--quiet"};
  for (const std::string& setting : settings) words.insert(words.end(), {"--set", setting});
  const Outcome outcome = here.run(words);
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
  EXPECT_EQ(unexplained(std::string(kShortConfig) + "opponents: {pool_size: 2, pool_every_updates: 1}\n",
                        {"mappo.shaping_final_factor=0.5", "mappo.shaping_final_factors.defeat_one_opponent=0"}),
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
  const Workplace here;
  std::string other_inputs, no_damage;
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(source_path("configs"))) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    const std::string text = here.run({"config", file.string()}).out, name = " `" + file.stem().string() + "`";
    if (text.find("inputs: egocentric") == std::string::npos) other_inputs += name;
    if (text.find("damage: 50") == std::string::npos) no_damage += name;
  }
  EXPECT_EQ(other_inputs, " `published` `published_corrected` `published_observation`");
  EXPECT_EQ(no_damage, " `memory` `published` `published_corrected`");
  EXPECT_TRUE(contains(page, {"but `published`, `published_corrected` and\n`published_observation`",
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
