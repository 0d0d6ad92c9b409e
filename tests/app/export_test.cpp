// gigastep export: files for other programs from a run, and the messages for mistakes.
#include <gtest/gtest.h>

#include <cerrno>

#include "program.hpp"
#include "runs.hpp"

namespace giga::test {
namespace {

/// One run for all tests of this file: team 0 learns, team 1 is scripted.
class ExportedRun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    here_ = new Workplace();
    here_->write("short.yaml", kShortConfig);
    training_ = here_->run({"train", "short.yaml", "--run-dir", "run", "--quiet", "--set", "train.opponent=circle",
                            "--set", "mappo.obs_norm=true"});
  }
  static void TearDownTestSuite() {
    delete here_;
    here_ = nullptr;
  }
  void SetUp() override { ASSERT_EQ(training_.code, 0) << training_.err; }

  static Outcome run_export(const std::string& from, const std::string& team, const std::string& format,
                            const std::string& out) {
    return here_->run({"export", from, "--team", team, "--format", format, "--out", out});
  }

  static Workplace* here_;
  static Outcome training_;
};
Workplace* ExportedRun::here_ = nullptr;
Outcome ExportedRun::training_;

TEST_F(ExportedRun, EveryFormatHasItsFiles) {
  const std::pair<std::string, std::string> files[] = {
      {"safetensors", "policy.safetensors"}, {"onnx", "policy.onnx"}, {"torchscript", "policy.pt"}};
  for (const auto& [format, file] : files) {
    const Outcome outcome = run_export("run", "0", format, format);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(contains(outcome.out, {format + ": the policy of team 0 after ", "python3 " + format + "/act.py"}));
    EXPECT_GT(here_->read(format + "/" + file).size(), 100u);
    const Document manifest = parse_yaml_text(here_->read(format + "/manifest.json"), "manifest.json");
    EXPECT_EQ(at(manifest, {"format"}).text, format);
    EXPECT_EQ(at(manifest, {"file"}).text, file);
  }
}

// Whole games, so that what is remembered from step to step counts.
TEST_F(ExportedRun, WithMemoryItPlaysAsItsRunDoes) {
  const Outcome trained =
      here_->run({"train", "short.yaml", "--run-dir", "remembers", "--quiet", "--set", "train.opponent=circle", "--set",
                  "mappo.actor.memory=lstm", "--set", "mappo.actor.memory_size=4"});
  ASSERT_EQ(trained.code, 0) << trained.err;
  const auto games = [](const std::string& player) {
    const Outcome outcome =
        here_->run({"eval", player, "--vs", "circle", "--episodes", "16", "--trust", "--json", "-"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return print_node(at(parse_yaml_text(outcome.out, player), {"sides"}).items.at(0));  // as team 0
  };
  const std::string expected = games("remembers");
  for (const char* format : {"safetensors", "torchscript"}) {
    const std::string folder = std::string("remembers_") + format;
    ASSERT_EQ(run_export("remembers", "0", format, folder).code, 0);
    EXPECT_EQ(number_at(parse_yaml_text(here_->read(folder + "/manifest.json"), format), {"state", "size"}), 2 * 4);
    EXPECT_EQ(games(folder), expected) << format;
  }
}

TEST_F(ExportedRun, OfARunItIsTheBestCheckpoint) {
  ASSERT_EQ(run_export("run", "0", "safetensors", "of_run").code, 0);
  ASSERT_EQ(run_export("run/checkpoints/best.h5", "0", "safetensors", "of_best").code, 0);
  EXPECT_EQ(here_->read("of_run/manifest.json"), here_->read("of_best/manifest.json"));
  EXPECT_EQ(here_->read("of_run/policy.safetensors"), here_->read("of_best/policy.safetensors"));
}

TEST_F(ExportedRun, TheManifestSaysWhereThePolicyIsFrom) {
  ASSERT_EQ(run_export("run/checkpoints/update_00000003.h5", "0", "safetensors", "third").code, 0);
  const Document manifest = parse_yaml_text(here_->read("third/manifest.json"), "manifest.json");
  EXPECT_EQ(number_at(manifest, {"training", "updates"}), 3);
  EXPECT_EQ(number_at(manifest, {"training", "agent_steps"}), 3 * 256);
  EXPECT_EQ(number_at(manifest, {"training", "team"}), 0);
  EXPECT_EQ(at(manifest, {"training", "scenario"}).text, "identical_1_vs_1_fobs_vec_void_disc");
  EXPECT_TRUE(contains(at(manifest, {"training", "scenario_yaml"}).text, {"team_0:"}));
  EXPECT_TRUE(contains(at(manifest, {"training", "config_yaml"}).text, {"obs_norm: true"}));
  EXPECT_EQ(print_node(at(manifest, {"architecture", "hidden"})), "[8]");
  EXPECT_EQ(at(manifest, {"action_selection"}).text, "sampled");
  EXPECT_EQ(at(manifest, {"architecture", "normalizes_observations"}).text, "true");
  EXPECT_EQ(number_at(manifest, {"observation", "size"}), 2 * 9);  // two agents, nothing else
}

TEST_F(ExportedRun, MistakesEndWithCodeTwoAndLeaveNothing) {
  here_->write("full/notes.txt", "mine");
  const std::vector<std::string> before = here_->entries();
  const auto refused = [](const Outcome& outcome, std::initializer_list<std::string> parts) {
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_TRUE(contains(outcome.err, parts));
  };
  refused(run_export("run", "0", "onyx", "new"), {"format 'onyx' is unknown; nearest: 'onnx'; allowed: safetensors"});
  refused(here_->run({"export", "run", "--team", "0", "--format", "onnx", "--view", "inputs", "--out", "new"}),
          {"view 'inputs' is unknown; nearest: 'input'; allowed: inside, input"});
  refused(here_->run({"export", "run", "--team", "0", "--format", "onnx", "--view", "input", "--out", "new"}),
          {"--view input: the policy of team 0", "does not read the egocentric view"});
  refused(run_export("run", "1", "onnx", "new"), {"team 1 of run", "did not learn in training; team 0 has one"});
  refused(run_export("run", "2", "onnx", "new"), {"--team"});
  refused(run_export("nowhere", "0", "onnx", "new"), {"there is no checkpoint or run folder nowhere"});
  refused(run_export("short.yaml", "0", "onnx", "new"), {"short.yaml"});
  refused(run_export("run", "0", "onnx", "full"), {"the folder full is not empty"});
  refused(run_export("run", "0", "onnx", "short.yaml"), {"short.yaml is a file"});
  refused(run_export("run", "0", "onnx", "short.yaml/new"), {"--out: short.yaml is a file, not a folder"});
  refused(run_export("run", "0", "onnx", "/proc/new"), {"cannot create the folder /proc/new"});
  refused(here_->run({"export", "run", "--team", "0", "--format", "onnx"}), {"--out"});
  EXPECT_EQ(here_->entries(), before);
  EXPECT_EQ(here_->read("full/notes.txt"), "mine");
}

// The policy and the example are written, then the disk is full (ENOSPC).
TEST_F(ExportedRun, AllFilesOrNone) {
  const std::vector<std::string> before = here_->entries();
  const Environment full_disk = {{"LD_PRELOAD", fault_library()},
                                 {"FAULT_PATH", "new/manifest.json"},
                                 {"FAULT_AT", "1"},
                                 {"FAULT_ERRNO", std::to_string(ENOSPC)}};
  const Outcome outcome =
      here_->run({"export", "run", "--team", "0", "--format", "onnx", "--out", "new"}, kGigastep, full_disk);
  EXPECT_EQ(outcome.code, 1);
  EXPECT_TRUE(contains(outcome.err, {"new/manifest.json", "No space left"}));
  EXPECT_EQ(here_->entries(), before);
}

}  // namespace
}  // namespace giga::test
