// TensorBoard's event files: their bytes, resume, and what TensorBoard's own code reads in them.
#include "io/tensorboard.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <limits>

#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "support/source.hpp"
#include "temporary_folder.hpp"

namespace giga::test {
namespace {

using namespace std::string_literals;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kFirstRecord = 40;  // bytes of the record that every file begins with

// The checksums below are those that TensorBoard's own code gives for the same bytes.

TEST(TensorBoard, BytesOfTheFirstRecord) {
  const TemporaryFolder folder;
  const TensorBoardEvents events = TensorBoardEvents::create(folder / "events", 1.5);
  const std::string wall_time = "\x09\0\0\0\0\0\0\xf8\x3f"s;  // field 1 * 8 + type 1: 1.5, 9 bytes
  const std::string version = "\x1a\x0d" + "brain.Event:2"s;  // field 3 * 8 + type 2: 13 characters, 15 bytes
  const std::string length = "\x18\0\0\0\0\0\0\0"s;           // 24 = 9 + 15
  EXPECT_EQ(read_file(folder / "events"), length + "\xa3\x7f\x4b\x22" + wall_time + version + "\x2a\x28\x64\x6c");
  EXPECT_EQ(events.size(), kFirstRecord);  // 8 + 4 + 24 + 4
}

TEST(TensorBoard, BytesOfAFigure) {
  const TemporaryFolder folder;
  TensorBoardEvents events = TensorBoardEvents::create(folder / "events", 0);
  events.scalars(300, 1.0, {{"x", 0.5}});
  const std::string wall_time = "\x09\0\0\0\0\0\0\xf0\x3f"s;                    // 1.0, 9 bytes
  const std::string step = "\x10\xac\x02"s;                                     // 300 = 44 + 2 * 128
  const std::string value = "\x0a\x0c\x0a\x05" + "run/x"s + "\x15\0\0\0\x3f"s;  // tag and 0.5: 12 bytes
  const std::string summary = "\x2a\x0e" + value;                               // field 5: 14 bytes
  const std::string length = "\x1c\0\0\0\0\0\0\0"s;                             // 28 = 9 + 3 + 16
  EXPECT_EQ(read_file(folder / "events").substr(kFirstRecord),
            length + "\xc8\xc1\x95\x1d" + wall_time + step + summary + "\xd5\x70\x58\xa7");
}

TEST(TensorBoard, WhatIsNotKnownIsLeftOut) {
  const TemporaryFolder folder;
  TensorBoardEvents events = TensorBoardEvents::create(folder / "all", 0);
  events.scalars(300, 1.0, {{"y", kNaN}, {"x", 0.5}});
  TensorBoardEvents one = TensorBoardEvents::create(folder / "one", 0);
  one.scalars(300, 1.0, {{"x", 0.5}});
  EXPECT_EQ(read_file(folder / "all"), read_file(folder / "one"));
  events.scalars(301, 2.0, {{"y", kNaN}, {"x", kNaN}});  // nothing to say: no record
  EXPECT_EQ(events.size(), one.size());
}

TEST(TensorBoard, ResumeCutsWhatIsBehind) {
  const TemporaryFolder folder;
  std::string once, twice;
  {
    TensorBoardEvents events = TensorBoardEvents::create(folder / "events", 0);
    events.scalars(1, 1.0, {{"x", 1.0}});
    const uint64_t size = events.size();
    events.scalars(2, 2.0, {{"x", 2.0}});
    once = read_file(folder / "events");
    events.scalars(3, 3.0, {{"x", 3.0}});

    TensorBoardEvents resumed = TensorBoardEvents::resume(folder / "events", size);
    EXPECT_EQ(resumed.size(), size);
    EXPECT_EQ(std::filesystem::file_size(folder / "events"), size);
    resumed.scalars(2, 2.0, {{"x", 2.0}});
    twice = read_file(folder / "events");
  }
  EXPECT_EQ(twice, once);
  EXPECT_TRUE(contains(input_error_of([&] { TensorBoardEvents::resume(folder / "events", once.size() + 1); }),
                       {"events", "the checkpoint says"}));
}

TEST(TensorBoard, NumbersOfHyperParametersAreFinite) {
  const TemporaryFolder folder;
  TensorBoardEvents events = TensorBoardEvents::create(folder / "events", 0);
  EXPECT_THROW(events.hyper_parameters({{"x", kNaN}}, {}, 0), Error);
  EXPECT_EQ(events.size(), kFirstRecord);
}

// The HPARAMS tab takes no more; the axis of the curves, agent-steps, does.
TEST(TensorBoard, StepsOfComparisonsHave31Bits) {
  const TemporaryFolder folder;
  TensorBoardEvents events = TensorBoardEvents::create(folder / "events", 0);
  EXPECT_THROW(events.comparison(2147483648, 0, {{"x", 1.0}}), Error);
  EXPECT_THROW(events.scalars(-1, 0, {{"x", 1.0}}), Error);
  EXPECT_EQ(events.size(), kFirstRecord);
}

TEST(TensorBoard, TagsStandInGroups) {
  EXPECT_EQ(tensorboard_tag("agent_steps_per_second"), "run/agent_steps_per_second");
  EXPECT_EQ(tensorboard_tag("policy_loss_1"), "policy_loss/team_1");
  EXPECT_EQ(tensorboard_tag("reward_damage_0"), "reward_damage/team_0");
  EXPECT_EQ(tensorboard_tag("win_rate_0_vs_circle"), "win_rate/team_0_vs_circle");
  EXPECT_EQ(tensorboard_tag("mean_return_1_vs_camper_0"), "mean_return/team_1_vs_camper_0");
  EXPECT_EQ(tensorboard_tag("layer_2"), "run/layer_2");  // there are two teams
  EXPECT_EQ(tensorboard_tag("_0"), "run/_0");
}

/// What the real reader finds in a folder: the output of read_tensorboard.py.
struct Reading {
  int code = -1;
  std::string out, err;
};

Reading read_with_tensorboard(const std::filesystem::path& folder) {
  const std::string python = python_with("sys");
  const TemporaryFolder streams;
  const auto quoted = [](const std::filesystem::path& path) { return shell_word(path.string()); };
  const std::string command = quoted(python) + " -B " + quoted(source_path("tests/io/read_tensorboard.py")) + " " +
                              quoted(folder) + " >" + quoted(streams / "out") + " 2>" + quoted(streams / "err");
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(streams / "out"), read_file(streams / "err")};
}

constexpr int kNotInstalled = 77, kNoPython = 127;  // the script's word, and the shell's
#define SKIP_WITHOUT_TENSORBOARD(reading)                             \
  if ((reading).code == kNotInstalled || (reading).code == kNoPython) \
  GTEST_SKIP() << "no TensorBoard to read with (scripts/bootstrap --dev): " << (reading).err

/// YAML on one line: JSON and the expectation, which is written more shortly, become the same text.
std::string one_line(const std::string& yaml) { return print_node(parse_yaml_text(yaml, "reading").root); }

TEST(TensorBoard, TheRealReaderFindsEverything) {
  const TemporaryFolder folder;
  {
    TensorBoardEvents events = TensorBoardEvents::create(folder / kTensorBoardFile, 1.7e9);
    events.hyper_parameters(
        {{"seed", 3.0}, {"mappo.gamma", 0.99}, {"train.desynchronize", false}, {"scenario", "caf\xC3\xA9 \"x\""}},
        {comparison_tag("win_rate_0_vs_circle")}, 1.7e9 + 0.25);
    events.text("config", "```yaml\nseed: 3\n```", 0, 1.7e9 + 0.5);
    events.scalars(4096, 1.7e9 + 1, {{"speed", 1e6}, {"entropy_0", 1.25}, {"entropy_1", -1.5}});
    // More agent-steps than 31 bits hold; 1e300 is infinite in single precision.
    events.scalars(20000000000, 1.7e9 + 2,
                   {{"speed", 3e6}, {"entropy_0", 1e300}, {"entropy_1", kNaN}, {"win_rate_0_vs_circle", 0.75}});
    events.comparison(12, 1.7e9 + 2, {{"win_rate_0_vs_circle", 0.75}});
    events.session_end(true, 1.7e9 + 3);
  }
  const Reading reading = read_with_tensorboard(folder.path());
  SKIP_WITHOUT_TENSORBOARD(reading);
  ASSERT_EQ(reading.code, 0) << reading.err;
  EXPECT_EQ(one_line(reading.out), one_line(R"(
scalars:
  "run/speed": [[4096, 1700000001.0, 1000000.0], [20000000000, 1700000002.0, 3000000.0]]
  "entropy/team_0": [[4096, 1700000001.0, 1.25], [20000000000, 1700000002.0, Infinity]]
  "entropy/team_1": [[4096, 1700000001.0, -1.5]]
  "win_rate/team_0_vs_circle": [[20000000000, 1700000002.0, 0.75]]
  "hparams/win_rate_0_vs_circle": [[12, 1700000002.0, 0.75]]
texts:
  config: [[0, 1700000000.5, "```yaml\nseed: 3\n```"]]
columns:
  hparams: {mappo.gamma: DATA_TYPE_FLOAT64, scenario: DATA_TYPE_STRING, seed: DATA_TYPE_FLOAT64,
            train.desynchronize: DATA_TYPE_BOOL}
  metrics: ["hparams/win_rate_0_vs_circle"]
sessions:
- run: "."
  status: STATUS_SUCCESS
  start: 1700000000.25
  end: 1700000003.0
  hparams: {mappo.gamma: 0.99, scenario: "café \"x\"", seed: 3.0, train.desynchronize: false}
  metrics: {"hparams/win_rate_0_vs_circle": [12, 0.75]}
)"));
}

TEST(TensorBoard, TheRealReaderFollowsAResumedRun) {
  const TemporaryFolder folder;
  {
    TensorBoardEvents events = TensorBoardEvents::create(folder / kTensorBoardFile, 0);
    events.hyper_parameters({{"seed", 1.0}}, {"run/x"}, 1);
    events.scalars(1, 1, {{"x", 1}});
    const uint64_t size = events.size();  // as in a checkpoint
    events.scalars(2, 2, {{"x", 2}});
    events.session_end(false, 3);
    TensorBoardEvents resumed = TensorBoardEvents::resume(folder / kTensorBoardFile, size);
    resumed.scalars(2, 12, {{"x", 20}});
    resumed.scalars(3, 13, {{"x", 30}});
  }
  const Reading reading = read_with_tensorboard(folder.path());
  SKIP_WITHOUT_TENSORBOARD(reading);
  ASSERT_EQ(reading.code, 0) << reading.err;
  EXPECT_EQ(one_line(reading.out), one_line(R"(
scalars: {"run/x": [[1, 1.0, 1.0], [2, 12.0, 20.0], [3, 13.0, 30.0]]}
texts: {}
columns: {hparams: {seed: DATA_TYPE_FLOAT64}, metrics: ["run/x"]}
sessions:
- {run: ".", status: STATUS_UNKNOWN, start: 1.0, end: 0.0, hparams: {seed: 1.0}, metrics: {"run/x": [3, 30.0]}}
)"));
}

}  // namespace
}  // namespace giga::test
