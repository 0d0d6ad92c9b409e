// Where commands write what they are told to: folders are made; what cannot be written is told before any work.
#include <gtest/gtest.h>

#include "program.hpp"
#include "runs.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

/// A command but for the option that says where to, and what it writes for that.
struct Writing {
  std::vector<std::string> command;
  std::string option, value;  ///< in the folders a/b, which are not there
  std::vector<std::string> written;
};

/// Every option of every command that names a file or a folder to be written.
std::vector<Writing> all_writings() {
  const std::vector<std::string> eval = {
      "eval", "circle", "--vs", "noop", "--scenario", "identical_2_vs_2_void", "--episodes", "2", "--device", "cpu"};
  const std::vector<std::string> record = {"record",     "circle", "--scenario", "identical_2_vs_2_void",
                                           "--episodes", "1",      "--device",   "cpu"};
  const std::vector<std::string> rate = {"rate", "run", "--scripted", "random", "--episodes", "2", "--device", "cpu"};
  const std::vector<std::string> picture = {"picture", "game.replay"};
  const std::vector<std::string> show = {"scenarios", "show", "identical_2_vs_2"};
  return {
      {eval, "--json", "a/b/x.json", {"a/b/x.json"}},
      {eval, "--csv", "a/b/x.csv", {"a/b/x.csv"}},
      {record, "--out", "a/b/x", {"a/b/x.replay", "a/b/x.html"}},
      {rate, "--json", "a/b/x.json", {"a/b/x.json"}},
      {rate, "--out", "a/b", {"a/b/ratings.json", "a/b/matrix.svg"}},
      {{"report", "run"}, "--out", "a/b/x.html", {"a/b/x.html"}},
      {{"inspect", "run"}, "--json", "a/b/x.json", {"a/b/x.json"}},
      {{"export", "run", "--team", "0", "--format", "safetensors"}, "--out", "a/b/x", {"a/b/x/manifest.json"}},
      {{"bench", "sim", "--scenario", "identical_2_vs_2", "--worlds", "4", "--steps", "2", "--repeats", "1", "--device",
        "cpu"},
       "--json",
       "a/b/x.json",
       {"a/b/x.json"}},
      {picture, "--out", "a/b/x.svg", {"a/b/x.svg"}},
      {picture, "--film", "a/b/x.gif", {"a/b/x.gif"}},
      {picture, "--film", "a/b/x", {"a/b/x/00000.png"}},
      {show, "--picture", "a/b/x.svg", {"a/b/x.svg"}},
      {{"sweep", "sweep.yaml"}, "--out", "a/b/x", {"a/b/x/trials.csv"}},
      {{"sweep", "sweep.yaml"}, "--json", "a/b/x.json", {"a/b/x.json"}},
      {{"exploit", "run", "--agent-steps", "256", "--episodes", "2", "--device", "cpu"},
       "--out",
       "a/b/x",
       {"a/b/x/exploit.json"}},
      {{"exploit", "run", "--agent-steps", "256", "--episodes", "2", "--device", "cpu"},
       "--json",
       "a/b/x.json",
       {"a/b/x.json"}},
      {{"train", "short.yaml", "--quiet"}, "--run-dir", "a/b/x", {"a/b/x/report.html"}},
  };
}

/// A folder with a run, a replay and a sweep.
void fill(const Workplace& here) {
  here.write("short.yaml", kShortConfig);
  here.write("sweep.yaml",
             "config: short.yaml\nset: [train.total_agent_steps=256]\n"
             "parameters: {mappo.gamma: {choices: [0.9]}}\ntrials: 1\nmetric: [episode_length]\n");
  ASSERT_EQ(here.run({"train", "short.yaml", "--quiet", "--run-dir", "run"}).code, 0);
  ASSERT_EQ(here.run({"record", "circle", "--scenario", "identical_2_vs_2_void", "--episodes", "1"}).code, 0);
}

TEST(Output, FoldersAreMade) {
  const Workplace here;
  fill(here);
  const std::vector<Writing> all = all_writings();
  const auto stride = static_cast<size_t>(thinned(4));
  for (size_t k = 0; k < all.size(); k += stride) {
    const Writing& writing = all[k];
    std::filesystem::remove_all(here.path() / "a");
    std::vector<std::string> words = writing.command;
    words.insert(words.end(), {writing.option, writing.value});
    const Outcome outcome = here.run(words);
    EXPECT_EQ(outcome.code, 0) << words[0] << ' ' << writing.option << '\n' << outcome.err;
    for (const std::string& file : writing.written)
      EXPECT_TRUE(here.has(file)) << words[0] << ' ' << writing.option << " wrote no " << file;
  }
}

// The files that are read are not there either: were they asked for first, the message would be about them.
TEST(Output, WhatCannotBeWrittenIsToldFirst) {
  const Workplace here;
  here.write("a", "a file where a folder is wanted");
  std::vector<Writing> all = all_writings();
  all.push_back({{"play", "run"}, "--out", "a/b/x", {}});
  all.push_back({{"play", "run"}, "--folder", "a/b/x", {}});
  for (const Writing& writing : all) {
    if (writing.option == "--run-dir") continue;  // below
    std::vector<std::string> words = writing.command;
    words.insert(words.end(), {writing.option, writing.value});
    const Outcome outcome = here.run(words);
    EXPECT_EQ(outcome.code, 2) << words[0];
    EXPECT_EQ(outcome.out, "") << words[0];
    EXPECT_TRUE(contains(outcome.err, {writing.option + ": a is a file, not a folder"})) << words[0];
    EXPECT_EQ(here.entries(), std::vector<std::string>{"a"}) << words[0];
  }
  const Outcome train = here.run({"train", "quickstart", "--run-dir", "a/b"});
  EXPECT_EQ(train.code, 2);
  EXPECT_TRUE(contains(train.err, {"a", "Not a directory"}));
}

TEST(Output, AFolderIsNoFile) {
  const Workplace here;
  std::filesystem::create_directory(here.path() / "folder");
  EXPECT_TRUE(contains(here.run({"report", "run", "--out", "folder"}).err, {"--out: folder is a folder, not a file"}));
  EXPECT_TRUE(contains(here.run({"report", "run", "--out", "new/"}).err, {"--out: new/ names no file"}));
  EXPECT_EQ(here.run({"report", "run", "--out", "new/x.html"}).code, 2);
  EXPECT_FALSE(here.has("new")) << "for a report of no run";
  EXPECT_TRUE(contains(here.run({"rate", "run", "--out", "/dev/null"}).err, {"--out: /dev/null is a file"}));
  EXPECT_TRUE(contains(here.run({"picture", "none.replay", "--out", "x.jpg"}).err, {"--out x.jpg: the ending says"}));
  EXPECT_TRUE(contains(here.run({"picture", "none.replay", "--film", "x.mp4"}).err, {"a name that ends in .gif"}));
  // What files begin with may be the name of a folder; where a file is a device it is written.
  EXPECT_EQ(here.run({"record", "circle", "--scenario", "identical_2_vs_2_void", "--out", "folder"}).code, 0);
  EXPECT_TRUE(here.has("folder.html"));
  EXPECT_EQ(here.run({"scenarios", "show", "identical_2_vs_2", "--picture", "folder/x.svg"}).code, 0);
  EXPECT_EQ(here.run({"eval", "circle", "--vs", "noop", "--scenario", "identical_2_vs_2_void", "--episodes", "1",
                      "--json", "/dev/null"})
                .code,
            0);
}

// A full disk must not leave half a result and say that all went well.
TEST(Output, WhatCannotBePrintedIsAFailure) {
  const Workplace here;
  for (const char* command : {"scenarios", "config quickstart", "scenarios show identical_2_vs_2", "--version"}) {
    const Outcome outcome = here.run({"-c", cat("exec '", kGigastep, "' ", command, " > /dev/full")}, "/bin/sh");
    EXPECT_EQ(outcome.code, 1) << command;
    EXPECT_TRUE(contains(outcome.err, {"gigastep: the output could not be written"})) << command;
  }
}

}  // namespace
}  // namespace giga::test
