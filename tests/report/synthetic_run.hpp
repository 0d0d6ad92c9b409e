// Run folders made by hand, for tests of reports.
#pragma once

#include <filesystem>
#include <string>

namespace giga::test {

/// The texts of a run folder; what a test does not care about is filled in.
struct SyntheticRun {
  std::string config = "scenario: duel\nseed: 1\ntrain: {total_agent_steps: 300}\nmappo: {gamma: 0.99}\n";
  std::string scenario = "max_health: 1\n";
  std::string info = R"({"scenario": "duel", "algorithm": "mappo", "seed": 1, "started": "2026-01-02T03:04:05Z",
    "command_line": ["gigastep", "train", "it's here"], "versions": {"gigastep": "0.1.0"},
    "hardware": {"device": "cpu", "cpu": "A \"fast\" one", "memory_bytes": 17179869184}})";
  std::string metrics = "update,agent_steps,seconds,entropy_0\r\n1,100,1,3\r\n2,200,2,2\r\n3,300,3,1\r\n";

  void write(const std::filesystem::path& folder) const;
};

/// A config that differs from the usual one in these two.
std::string config_with(int seed, const std::string& gamma);

/// 120 updates of 1000 agent-steps in 0.5 s each, of a run like those of `gigastep train`: entropies fall from 3 to
/// 0.62, win rates against circle rise from `offset` by 0.005 per update and are known at every tenth.
std::string metrics_of_a_run(double offset);

}  // namespace giga::test
