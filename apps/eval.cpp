// gigastep eval: plays the policies of a checkpoint against a scripted team, from both sides.
#include <CLI/CLI.hpp>
#include <iostream>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/evaluation.hpp"
#include "apps/program_info.hpp"
#include "cuda/runtime.hpp"
#include "eval/policies.hpp"
#include "io/run_folder.hpp"

namespace giga {
namespace {

struct EvalOptions {
  std::string policy, opponent, device = "auto", json;
  int episodes = 1024;
  uint64_t seed = 0;
  bool greedy = false;
};

Json side_json(const TeamResult& r) {
  const Interval ci = wilson95(r.wins(), r.match.episodes);
  Json side = Json::object();
  side.set("team", r.team).set("episodes", r.match.episodes);
  side.set("wins", r.wins()).set("losses", r.losses()).set("ties", r.match.ties);
  side.set("win_rate", r.share(r.wins())).set("win_rate_ci95", Json::array(std::vector<double>{ci.lo, ci.hi}));
  side.set("mean_return", r.match.mean_return[r.team]).set("mean_length", r.match.mean_length);
  side.set("mean_return_original", r.match.mean_return_masked[r.team]).set("mean_score", r.match.mean_score[r.team]);
  return side;
}

Json result_json(const EvalOptions& o, const std::string& file, const Checkpoint& checkpoint,
                 const std::vector<TeamResult>& results) {
  Json sides = Json::array();
  for (const TeamResult& r : results) sides.push(side_json(r));
  Json json = Json::object();
  json.set("a", o.policy).set("b", o.opponent).set("scenario", checkpoint.scenario_name).set("sides", std::move(sides));
  json.set("checkpoint", file).set("updates", checkpoint.updates).set("agent_steps", checkpoint.agent_steps);
  json.set("seed", o.seed).set("greedy", o.greedy).set("versions", version_info());
  return json;
}

void evaluate_checkpoint(const EvalOptions& o) {
  parse_scripted(o.opponent);  // a wrong name is told before anything is read
  const Device device = parse_device(o.device);
  const FoundCheckpoint found = find_checkpoint(o.policy);
  const std::string file = found.file.string();
  for (const std::string& line : found.damaged) std::cerr << "warning: " << line << "; " << file << " is taken\n";
  const Checkpoint& checkpoint = found.checkpoint;
  const LoadedPolicies loaded =
      load_policies(checkpoint.config_yaml, checkpoint.scenario_yaml, checkpoint.arrays, device);

  const MatchOptions options{o.episodes, o.seed, device, loaded.run.config.train.n_threads};
  std::vector<TeamResult> results;
  for (int team = 0; team < kNTeams; ++team) {
    if (loaded.actor[team]) {
      const Player player{loaded.actor[team].get(), Scripted::random, o.greedy || acts_greedily(loaded.run.config)};
      results.push_back(play_script(loaded.run.spec, player, team, o.opponent, options));
    } else {
      std::cerr << "team " << team << " has no learned policy (it was scripted in training) and is left out\n";
    }
  }

  if (!o.json.empty()) write_json(result_json(o, file, checkpoint, results), o.json);
  if (o.json != "-")
    std::cout << checkpoint.scenario_name << ", " << file << ", after " << checkpoint.updates << " updates\n"
              << results_table(results);
}

}  // namespace

void add_eval_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("eval", "play the policies of a run against a scripted team");
  auto options = std::make_shared<EvalOptions>();
  command->add_option("A", options->policy, "checkpoint file, or run folder (its newest whole checkpoint)")
      ->required()
      ->type_name("");
  command->add_option("--vs", options->opponent, "random, noop, circle, reverse_circle or circle_random")
      ->required()
      ->type_name("SCRIPT");
  command->add_option("--episodes", options->episodes, "episodes per side")
      ->check(CLI::Range(1, 10'000'000))
      ->capture_default_str()
      ->type_name("N");
  command->add_option("--seed", options->seed, "seed of the episodes: same seed, same result")
      ->capture_default_str()
      ->type_name("S");
  add_device_option(*command, options->device)->capture_default_str();
  command->add_flag("--greedy", options->greedy, "take the most likely action instead of drawing one; policies that evolved with population.greedy always do");
  add_json_option(*command, options->json);
  command->footer(
      "Team 0's policy plays on side 0, then team 1's on side 1. A tie is no win. Intervals are Wilson's, 95 %. "
      "Lengths\n"
      "are steps of 0.1 s; mean_return is the sum of all rewards of the team in an episode, mean_return_original that\n"
      "of the original's evaluator (living agents, without the last step), mean_score counts waypoints.\n"
      "Examples:\n"
      "  gigastep eval runs/identical_5_vs_5-mappo-seed1-001 --vs circle\n"
      "  gigastep eval runs/first/checkpoints/update_00000100.h5 --vs random --episodes 4096 --seed 7 --json -");
  command->callback([options, &dispatch] { dispatch.run = [options] { evaluate_checkpoint(*options); }; });
}

}  // namespace giga
