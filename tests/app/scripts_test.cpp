// The scripts that say of which sources a figure is: scripts/commit, scripts/gpu_check --fresh, scripts/measure docs.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <thread>

#include "io/files.hpp"
#include "program.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

namespace fs = std::filesystem;

/// A folder with copies of some scripts and a source, called as scripts are.
class Copy {
 public:
  Copy() {
    fs::create_directories(here_.path() / "tree/scripts");
    for (const char* name : {"commit", "gpu_check"})
      fs::copy_file(source_path(std::string("scripts/") + name), here_.path() / "tree/scripts" / name);
    write("lib/a.hpp", "int a();\n");
    write("lib/sub/b.cpp", "int b();\n");
    write("docs/page.md", "a page\n");
  }

  void write(const std::string& name, const std::string& text) const {
    fs::create_directories((here_.path() / "tree" / name).parent_path());
    here_.write("tree/" + name, text);
  }
  std::string read(const std::string& name) const { return here_.read("tree/" + name); }
  Outcome run(const std::string& script, const std::vector<std::string>& arguments = {},
              const Environment& environment = {}) const {
    return here_.run(arguments, (here_.path() / "tree/scripts" / script).string(), environment);
  }
  Outcome git(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(),
                     {"git", "-C", (here_.path() / "tree").string(), "-c", "user.name=a", "-c", "user.email=a@b.c"});
    return here_.run(arguments, "/usr/bin/env");
  }
  const Workplace& here() const { return here_; }

 private:
  Workplace here_;
};

TEST(Scripts, CommitOfACopyIsWhatTheEnvironmentSays) {
  const Copy copy;
  const Outcome unknown = copy.run("commit", {}, {{"GIGASTEP_COMMIT", ""}});
  EXPECT_EQ(unknown.out, "unknown\n") << unknown.err;
  EXPECT_EQ(copy.run("commit", {}, {{"GIGASTEP_COMMIT", "0123abc"}}).out, "0123abc\n");
  EXPECT_EQ(copy.run("commit", {}, {{"GIGASTEP_COMMIT", "a\"; evil"}}).code, 2);  // it goes into a source file
}

TEST(Scripts, CommitOfACheckoutTellsChangedSources) {
  const Copy copy;
  if (copy.git({"init", "-q"}).code != 0) GTEST_SKIP() << "no git";
  ASSERT_EQ(copy.git({"add", "."}).code, 0);
  const Outcome made = copy.git({"commit", "-q", "-m", "first"});
  ASSERT_EQ(made.code, 0) << made.err;
  const std::string commit = copy.git({"rev-parse", "--short=12", "HEAD"}).out;
  const std::string name = commit.substr(0, 12);

  EXPECT_EQ(copy.run("commit", {}, {{"GIGASTEP_COMMIT", "other"}}).out, "other\n");  // a copy into this checkout
  copy.write("docs/page.md", "another page\n");
  EXPECT_EQ(copy.run("commit", {}, {{"GIGASTEP_COMMIT", ""}}).out,
            name + "\n");  // pages do not change what the program does
  copy.write("lib/c.cpp", "int c();\n");
  EXPECT_EQ(copy.run("commit", {}, {{"GIGASTEP_COMMIT", ""}}).out, name + "-dirty\n");
}

/// A page of these sources with rows of all six steps.
void write_page(const Copy& copy, const std::string& hash, const std::string& result_of_tests) {
  std::string page = "Sources: `" + hash + "`\n\n";
  for (const std::string step : {"build", "test", "bench", "train", "resume"})
    page += "| " + step + " | what | " + (step == "test" ? result_of_tests : "ok") + " | 1.0 | | | | |\n";
  for (const std::string tool : {"memcheck", "racecheck"})
    for (const std::string what : {"parity of small teams", "compiled steps", "parity of large teams",
                                   "parity of crowds", "parity of crowds of 110", "parity of crowds of 207",
                                   "parity of images", "populations", "fused gradients", "layers"})
      page += "| others | " + tool + ": " + what + " | ok | 1.0 | | | | |\n";
  page += "| others | all other tests | ok | 1.0 | | | | |\n";
  copy.write("docs/gpu_check.md", page);
}

TEST(Scripts, FreshComparesThePageWithTheSources) {
  const Copy copy;
  const auto fresh = [&] { return copy.run("gpu_check", {"--fresh"}); };
  EXPECT_EQ(fresh().code, 1);
  EXPECT_TRUE(contains(fresh().out, {"not checked"}));

  // The hash by hand: names and contents of the sources in the order of their bytes.
  const Outcome sums = copy.here().run(
      {"-c", "cd tree && sha256sum lib/a.hpp lib/sub/b.cpp | sha256sum | cut -c1-64 | tr -d '\\n'"}, "/bin/sh");
  ASSERT_EQ(sums.out.size(), 64u) << sums.err;
  write_page(copy, sums.out, "ok");
  EXPECT_EQ(fresh().code, 0) << fresh().out;
  EXPECT_EQ(copy.run("gpu_check", {"--fresh"}, {{"LC_ALL", "C"}}).code, 0);

  // What is no source does not matter; what failed does; so does any changed, renamed or new source.
  copy.write("lib/notes.txt", "nothing\n");
  copy.write("docs/page.md", "another page\n");
  EXPECT_EQ(fresh().code, 0);
  write_page(copy, sums.out, "FAILED (1)");
  EXPECT_EQ(fresh().code, 1);
  EXPECT_TRUE(contains(fresh().out, {"1 rows failed"}));
  write_page(copy, sums.out, "ok");
  copy.write("docs/gpu_check.md", copy.read("docs/gpu_check.md") + "| test | what | ok | 1.0 | | no GPU | | |\n");
  EXPECT_EQ(fresh().code, 1);
  write_page(copy, sums.out, "ok");
  std::string page = copy.read("docs/gpu_check.md");
  page.erase(page.find("| others | racecheck: populations"),
             page.find("| others | racecheck: fused") - page.find("| others | racecheck: populations"));
  copy.write("docs/gpu_check.md", page);
  EXPECT_TRUE(contains(fresh().out, {"no rows of others (racecheck: populations)"}));
  write_page(copy, sums.out, "ok");
  copy.write("lib/sub/b.cpp", "int b(int);\n");
  EXPECT_EQ(fresh().code, 1);
  copy.write("lib/sub/b.cpp", "int b();\n");
  EXPECT_EQ(fresh().code, 0);
  copy.write("cuda/c.cu", "int c();\n");
  EXPECT_EQ(fresh().code, 1);
}

TEST(Scripts, FreshAsksForEveryStep) {
  const Copy copy;
  const Outcome sums = copy.here().run(
      {"-c", "cd tree && sha256sum lib/a.hpp lib/sub/b.cpp | sha256sum | cut -c1-64 | tr -d '\\n'"}, "/bin/sh");
  copy.write("docs/gpu_check.md", "Sources: `" + sums.out + "`\n\n| bench | what | ok | 1.0 | | | | |\n");
  const Outcome fresh = copy.run("gpu_check", {"--fresh"});
  EXPECT_EQ(fresh.code, 1);
  EXPECT_TRUE(contains(fresh.out, {"no rows of build test others train resume"}));
}

// A sanitizer's row of parity is true as long as the simulator is: its own files, what these include, and the tests.
TEST(Scripts, WhatSanitizersFoundInParityStaysWithTheSimulator) {
  const Copy copy;
  copy.write("cuda/k.cu", "#include \"sub/formula.hpp\"\n");
  copy.write("lib/sub/formula.hpp", "#include \"deep.hpp\"\n");
  copy.write("lib/deep.hpp", "int deep();\n");
  copy.write("tests/parity/k_test.cpp", "int test();\n");
  const std::string theirs = "| others | memcheck: parity of crowds of 110 | ok | 1.0 | | | | |\n";
  const std::string host = "| others | memcheck: layers | ok | 1.0 | | | | |\n";
  // Without a program the step fails at once, but its rows are written.
  const auto checked = [&] {
    EXPECT_EQ(copy.run("gpu_check", {"bench"}).code, 1);
    return copy.read("docs/gpu_check.md");
  };
  const auto with_rows = [&] {
    const std::string page = checked() + theirs + host;
    copy.write("docs/gpu_check.md", page);
    return checked();
  };
  EXPECT_TRUE(contains(with_rows(), {theirs, host}));  // nothing changed

  copy.write("lib/sub/b.cpp", "int b(int);\n");
  EXPECT_TRUE(contains(checked(), {theirs}));
  EXPECT_FALSE(contains(checked(), {host}));
  for (const char* name : {"cuda/k.cu", "lib/sub/formula.hpp", "lib/deep.hpp", "tests/parity/k_test.cpp"}) {
    ASSERT_TRUE(contains(with_rows(), {theirs, host})) << name;
    copy.write(name, copy.read(name) + "// changed\n");
    EXPECT_FALSE(contains(checked(), {theirs})) << name;
  }
}

// Everything that scripts/measure does, with tiny sizes on the CPU: rows as soon as they are measured, nothing twice,
// tables.
TEST(Scripts, MeasureWritesRowsAndTables) {
  if (!tests_run_in_full()) GTEST_SKIP() << "slow; run with GIGASTEP_TEST_FULL=1";
  const Copy copy;
  if (copy.here().run({"python3", "--version"}, "/usr/bin/env").code != 0) GTEST_SKIP() << "no python3";
  const fs::path tree = copy.here().path() / "tree", source = source_path();
  for (const char* file : {"scripts/measure", "scripts/measuring.py"}) fs::copy_file(source / file, tree / file);
  std::string old_page = read_file((source / "docs/measurements.md").string());
  for (const std::string block : {"mappo", "evolution"}) {
    const std::string begin = "<!-- measure:" + block + " -->\n";
    const size_t at = old_page.find(begin) + begin.size();
    old_page.replace(at, old_page.find("<!-- /measure -->", at) - at, "an older table\n");
  }
  copy.write("docs/measurements.md", old_page);
  fs::copy(source / "configs", tree / "configs");
  const Environment environment = {{"GIGASTEP_MEASURE_TINY", "1"},
                                   {"BUILD", fs::path(kGigastep).parent_path().parent_path().string()},
                                   {"OUT", (tree / "build/measure_tiny").string()}};
  const auto measure = [&](const std::vector<std::string>& arguments) {
    return copy.run("measure", arguments, environment);
  };

  // Two runs of two seeds at most are done in a call without time; those that are left say so.
  EXPECT_EQ(measure({"cpu", "quickstart", "--limit", "0"}).code, 3);
  for (const char* piece : {"quickstart", "bench-cpu"}) {
    const Outcome outcome = measure({"cpu", piece});
    EXPECT_EQ(outcome.code, 0) << outcome.out << outcome.err;
  }
  const std::string rows = copy.read("build/measure_tiny/quickstart.jsonl");
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 2);  // a row per seed
  EXPECT_TRUE(contains(measure({"cpu"}).out, {"5 of 5 measured"}));
  EXPECT_EQ(copy.read("build/measure_tiny/quickstart.jsonl"), rows);
  EXPECT_TRUE(contains(measure({"left"}).out, {"left: mappo: MAPPO, seed 1"}));

  const Outcome docs = measure({"docs"});
  ASSERT_EQ(docs.code, 0) << docs.out << docs.err;
  const std::string page = copy.read("build/measure_tiny/measurements.md");
  EXPECT_TRUE(contains(
      page, {"| the quickstart | ", "| 1, 2 | ", "wins against evader", "| sim, identical_5_vs_5, 64 worlds | fp32 |",
             "rollout ", "learning ", "`gigastep train configs/quickstart.yaml --seed S",
             "<!-- measure:mappo -->\nan older table\n<!-- /measure -->"}));

  // Runs whose checkpoints play each other.
  const Outcome duels = measure({"gpu-learn", "recurrent"});
  ASSERT_EQ(duels.code, 0) << duels.out << duels.err;
  ASSERT_EQ(measure({"docs"}).code, 0);
  EXPECT_TRUE(contains(copy.read("build/measure_tiny/measurements.md"),
                       {"| identical_5_vs_5, GRU, 60 M | ", "wins as team 0 / as team 1",
                        "| hide_and_seek_5_vs_5, GRU, 60 M against no memory, 600 M | 1, 2 | "}));

  // Rows of another machine come in once. Of two rows of a command the newer one is shown; those of others stay, also
  // where their rows are not here any more.
  const std::string train =
      "gigastep bench train --config quickstart --worlds 64 --steps 1 --repeats 2 --set mappo.horizon=8 "
      "--set mappo.n_minibatches=1 --device cpu";
  ASSERT_TRUE(contains(page, {"`" + train + "` |"}));
  copy.write("other.jsonl", R"({"key": "bench-cpu: x", "piece": "bench-cpu", "commit": "feedc0de", "device": "a GPU",
    "date": "2999-01-01T00:00:00+00:00", "command": ")" +
                                train + R"(", "kind": "train", "scenario": "s", "results": [
    {"worlds": 8, "arithmetic": "bf16", "agent_steps_per_second": 2e9, "interquartile": [1e9, 3e9], "checksum": {}}]})");
  std::string line = copy.read("other.jsonl");
  line.erase(std::remove(line.begin(), line.end(), '\n'), line.end());
  copy.write("other.jsonl", line + "\n");
  const std::string other = (tree / "other.jsonl").string();
  EXPECT_TRUE(contains(measure({"add", other}).out, {"1 new rows"}));
  EXPECT_TRUE(contains(measure({"add", other}).out, {"0 new rows"}));
  for (const bool forgotten : {false, true}) {
    if (forgotten) {
      copy.write("docs/measurements.md", copy.read("build/measure_tiny/measurements.md"));
      copy.write("build/measure_tiny/bench-cpu.jsonl", line + "\n");
    }
    ASSERT_EQ(measure({"docs"}).code, 0);
    const std::string newer = copy.read("build/measure_tiny/measurements.md");
    EXPECT_TRUE(
        contains(newer, {"n_minibatches=1), s, 8 worlds | bf16 | **2 G** (1 G to 3 G) |  | a GPU | `feedc0de` |",
                         "| sim, identical_5_vs_5, 64 worlds | fp32 |", "| closed-loop, identical_5_vs_5, 64"}));
    EXPECT_EQ(newer.find("n_minibatches=1), identical_5_vs_5"), std::string::npos);
  }
  EXPECT_TRUE(contains(measure({"left", "--only", "closed-loop"}).out, {"left: gpu-bench: closed-loop"}));
  EXPECT_EQ(measure({"left", "--only", "closed-loop"}).out.find("left: gpu-bench: sim"), std::string::npos);
  EXPECT_TRUE(contains(measure({"left", "--only", "closd-loop"}).err, {"--only: nothing has 'closd-loop'"}));

  // Of pieces of which no row is here any more the lines stay too, of runs and of duels, and nobody says that they were
  // not measured.
  copy.write("docs/measurements.md", copy.read("build/measure_tiny/measurements.md"));
  const std::string recurrent = copy.read("build/measure_tiny/recurrent.jsonl");
  copy.write("build/measure_tiny/recurrent.jsonl", recurrent.substr(0, recurrent.find('\n') + 1));
  ASSERT_EQ(measure({"docs"}).code, 0);
  EXPECT_TRUE(contains(
      copy.read("build/measure_tiny/measurements.md"),
      {"| identical_5_vs_5, GRU, 60 M | ", "| hide_and_seek_5_vs_5, GRU, 60 M against no memory, 600 M | 1, 2 | "}));
  ASSERT_EQ(measure({"gpu-learn", "mappo"}).code, 0);
  ASSERT_EQ(measure({"docs"}).code, 0);
  EXPECT_TRUE(contains(copy.read("build/measure_tiny/measurements.md"), {"`scripts/measure gpu-learn league`."}));
  ASSERT_EQ(measure({"gpu-learn", "league"}).code, 0);
  ASSERT_EQ(measure({"docs"}).code, 0);
  copy.write("docs/measurements.md", copy.read("build/measure_tiny/measurements.md"));
  copy.write("build/measure_tiny/league.jsonl", "");
  ASSERT_EQ(measure({"docs"}).code, 0);
  const std::string kept = copy.read("build/measure_tiny/measurements.md");
  EXPECT_TRUE(contains(kept, {"| MAPPO with a league | "}));
  EXPECT_EQ(kept.find("`scripts/measure gpu-learn league`."), std::string::npos);

  // Stopped, it ends what it has begun, and leaves nothing of it.
  for (const int signal : {SIGINT, SIGTERM}) {
    const auto stopped = copy.here().start({"settings"}, (tree / "scripts/measure").string(), environment);
    const auto trains = [&] {
      return fs::exists(tree / "build/measure_tiny/runs") && !fs::is_empty(tree / "build/measure_tiny/runs");
    };
    for (int k = 0; k < 600 && !trains(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    ASSERT_TRUE(trains());
    stopped->send(signal);
    const Outcome outcome = stopped->wait();
    EXPECT_EQ(outcome.code, 128 + signal) << outcome.out << outcome.err;
    EXPECT_TRUE(contains(outcome.out, {"\nstopped: settings: "}));
    EXPECT_FALSE(trains());
  }
}

// scripts/reproduce, with tiny sizes on the CPU: rows of runs and of best responses, nothing twice, the table.
TEST(Scripts, ReproduceWritesItsTable) {
  if (!tests_run_in_full()) GTEST_SKIP() << "slow; run with GIGASTEP_TEST_FULL=1";
  const Copy copy;
  if (copy.here().run({"python3", "--version"}, "/usr/bin/env").code != 0) GTEST_SKIP() << "no python3";
  const fs::path tree = copy.here().path() / "tree", source = source_path();
  for (const char* file : {"scripts/measuring.py", "scripts/reproduce", "docs/reproduce.md"})
    fs::copy_file(source / file, tree / file);
  fs::copy(source / "configs", tree / "configs");
  const Environment environment = {{"GIGASTEP_MEASURE_TINY", "1"},
                                   {"BUILD", fs::path(kGigastep).parent_path().parent_path().string()},
                                   {"OUT", (tree / "build/reproduce_tiny").string()}};
  const auto reproduce = [&](const std::vector<std::string>& arguments) {
    return copy.run("reproduce", arguments, environment);
  };
  const std::vector<std::string> part = {"--scenario", "identical_5_vs_5", "--algorithm", "mappo"};
  const Outcome first = reproduce(part);
  EXPECT_EQ(first.code, 0) << first.out << first.err;
  EXPECT_TRUE(contains(first.out, {"4 of 4 measured"}));  // two seeds, and the responses to each
  EXPECT_EQ(reproduce({"--scenario", "waypoint_3_vs_3", "--algorithm", "snes"}).code, 0);
  EXPECT_EQ(reproduce({"--scenario", "identical_1_vs_1", "--algorithm", "openai_es"}).code, 0);  // a config of its own
  // Those of five ways of learning, then the responses, which are there, and a league for each seed.
  EXPECT_TRUE(contains(reproduce({"--scenario", "identical_5_vs_5"}).out, {"14 of 14 measured"}));
  const std::string rows = copy.read("build/reproduce_tiny/exploit.jsonl");
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 2);
  EXPECT_EQ(reproduce(part).code, 0);
  EXPECT_EQ(copy.read("build/reproduce_tiny/exploit.jsonl"), rows);
  EXPECT_TRUE(contains(reproduce({"left"}).out, {"left: des: identical_1_vs_1, seed 1"}));
  EXPECT_EQ(reproduce({"scripts", "--scenario", "identical_5_vs_1"}).code, 0);
  EXPECT_TRUE(contains(reproduce({"long", "--quick"}).err, {"argument --quick: means nothing to long"}));
  EXPECT_TRUE(
      contains(reproduce({"--quick", "--algorithm", "snes", "--seed", "2"}).err, {"nothing to run with that --seed"}));
  EXPECT_TRUE(contains(reproduce({"--algorithm", "mappo_longer", "--scenario", "waypoint_5_vs_5"}).err,
                       {"nothing to run; mappo_longer is of identical_5_vs_5 only"}));
  EXPECT_TRUE(contains(reproduce({"long", "--scenario", "identical_5_vs_1"}).out, {"2 of 2 measured"}));
  EXPECT_TRUE(contains(reproduce({"minute"}).out, {"10 of 10 measured"}));  // four ways of learning, and their league
  // A line of which no row is here stays as it was; one of a measured scenario does not.
  const std::string old_page = copy.read("docs/reproduce.md"), old_line = "| a_game | mappo | 7 | long ago |\n";
  const std::string head = "<!-- reproduce:learned -->\n";
  copy.write("docs/reproduce.md", old_page.substr(0, old_page.find(head) + head.size()) +
                                      "| scenario | algorithm | seeds | device |\n|---|---|---|---|\n" + old_line +
                                      "| identical_5_vs_5 | mappo | 7 | long ago |\n" +
                                      old_page.substr(old_page.find("<!-- /reproduce -->")));
  ASSERT_EQ(reproduce({"docs"}).code, 0);
  const std::string page = copy.read("build/reproduce_tiny/reproduce.md");
  EXPECT_TRUE(contains(page, {"| identical_5_vs_5 | mappo | 1, 2 |", "| waypoint_3_vs_3 | snes | 1, 2 |",
                              "wins against evader", "best response to team 0 wins", "gigastep exploit",
                              "| identical_5_vs_1 | best script | - |", "1.000 pursuer", "| a_game | mappo | 7 | - |",
                              "| player | Elo ahead of pursuer", "| mappo_longer | ", "| snes_minute | ", "| circle | ",
                              "team 1 against circle: largest fall; last", "--set eval.every_updates="}));
  EXPECT_EQ(page.find("| identical_5_vs_5 | mappo | 7 |"), std::string::npos);
}

}  // namespace
}  // namespace giga::test
