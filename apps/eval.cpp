// gigastep eval: plays anybody against anybody: the policies of checkpoints, exported policies, TorchScript modules and
// scripted teams.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/load_player.hpp"
#include "apps/match_note.hpp"
#include "apps/match_report.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "core/seeds.hpp"
#include "cuda/runtime.hpp"
#include "eval/information_meter.hpp"
#include "eval/played_game.hpp"
#include "io/files.hpp"

namespace giga {
namespace {

struct EvalOptions {
  std::string a, b, scenario, device = "auto", csv, json;
  std::vector<std::string> changes;
  int episodes = 1024;
  uint64_t seed = 0;
  bool both_sides = false, greedy = false, information = false, trust = false;
};

/// The sides that A plays on, B on the other. Against a script each policy of A plays on its own side.
std::vector<int> sides_of(const EvalOptions& o, const Player& a, const Player& b) {
  if (o.both_sides) return {0, 1};
  if (!b.script() || a.script()) return {0};
  std::vector<int> sides;
  for (int side = 0; side < kNTeams; ++side) {
    if (a.can_play(side)) {
      sides.push_back(side);
      continue;
    }
    std::vector<std::string> unable;
    for (const Player* member : a.members())
      if (!member->can_play(side)) unable.push_back(member->name());
    std::cerr << "team " << side << " is left out, which did not learn in the training of " << join(unable) << '\n';
  }
  return sides;
}

/// Of a mixed team those of its members.
Json origin_json(const Player& c) {
  if (c.is_mixed()) {
    Json all = Json::array();
    for (const Player* member : c.members()) all.push_back(origin_json(*member));
    return all;
  }
  if (!c.origin()) return {};
  return {{"file", c.origin()->file},
          {"updates", c.origin()->updates},
          {"agent_steps", c.origin()->agent_steps},
          {"scenario", c.origin()->scenario_name}};
}

Json to_json(const EvalOptions& o, const MatchReport& report, const Player& a, const Player& b) {
  Json sides = Json::array();
  for (const TeamResult& r : report.results) sides.push_back(result_json(report, r));
  return {{"a", o.a},
          {"b", o.b},
          {"scenario", report.scenario},
          {"changes", o.changes},
          {"win", report.win},
          {"sides", std::move(sides)},
          {"origin_a", origin_json(a)},
          {"origin_b", origin_json(b)},
          {"seed", o.seed},
          {"greedy", o.greedy},
          {"versions", version_info()}};
}

void print_origin(const Player& c) {
  for (const Player* member : c.members())
    if (const Player::Origin* origin = member->origin())
      std::cout << c.name() << ": " << origin->file << ", after "
                << counted(origin->updates, algorithm_of(origin->run.config).updates) << '\n';
}

void play(const EvalOptions& o) {
  if (o.csv == "-" && o.json == "-")
    throw InputError("--csv - and --json - would both be printed; write one of them to a file");
  const auto place = [](const std::string& file) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(file));
  };
  if (!o.csv.empty() && !o.json.empty() && o.csv != "-" && o.json != "-" && place(o.csv) == place(o.json))
    throw InputError(cat("--csv and --json would both be written to ", o.csv, "; name two files"));
  const Device device = parse_device(o.device);
  const PlayerOptions loading{device, o.trust, o.greedy};
  Player b = load_player(o.b, loading);  // first: a wrong name is told before anything large is read
  Player a = load_player(o.a, loading);
  const PlayedGame game = choose_game({o.scenario, o.changes}, {&a, &b}, OtherGames::allowed);
  for (const std::string& note : game.notes) std::cerr << "note: " << note << '\n';
  const SimSpec& spec = game.spec;
  const MatchOptions options{o.episodes, seed_of(o.seed, Purpose::eval), device, 0, note_once()};
  MatchReport report{o.a, spec.name, {}, {}, {}, {}};
  const SimParams played = spec.with_time_limit().params;
  report.win = describe_win(played.win, played.max_episode_length);
  for (const Player* member : a.members()) report.policies_of_a.push_back(member->name());
  for (const Player* member : b.members()) report.policies_of_b.push_back(member->name());
  struct Match {
    int side;
    std::shared_ptr<TeamController> team[kNTeams];
    Minds minds;
  };
  std::vector<Match> matches;  // all before the first is played: who cannot play is told at once
  for (const int side : sides_of(o, a, b)) {
    Player &side0 = side == 0 ? a : b, &side1 = side == 0 ? b : a;
    matches.push_back({side, {side0.controller(0, spec), side1.controller(1, spec)}, {}});
    matches.back().minds = {side0.mind(0, spec), side1.mind(1, spec)};
  }
  const auto is_learned = [](const Match& m) { return m.minds[0].policy || m.minds[1].policy; };
  if (o.information && std::none_of(matches.begin(), matches.end(), is_learned))
    std::cerr << "note: --information measures single learned policies, and neither is one\n";
  for (const Match& m : matches) {
    InformationMeter meter(spec, m.minds);
    std::vector<GameObserver*> observers;
    if (o.information) observers.push_back(&meter);
    report.results.push_back({m.side, o.b, play_match(spec, m.team[0], m.team[1], options, observers)});
    if (o.information) report.results.back().match.mutual_information = meter.nats();
  }

  if (o.csv != "-" && o.json != "-") {  // before the files, one of which may not be writable
    std::cout << "scenario " << report.scenario << '\n';
    if (!o.changes.empty()) std::cout << "changed: " << join(o.changes) << '\n';
    std::cout << report.win << '\n';
    print_origin(a);
    print_origin(b);
    std::cout << '\n' << report_text(report) << std::flush;
  }
  if (!o.csv.empty()) write_or_print(o.csv, report_csv(report));
  if (!o.json.empty()) write_json(to_json(o, report, a, b), o.json);
}

const char* const kEvalHelp =
    "A and B are, each: a checkpoint file; a run folder (its best checkpoint, or its newest if none is called best); "
    "an\n"
    "exported policy (the folder that export wrote, or its safetensors file; ONNX is not read); a TorchScript module\n"
    "(observations [B, F] in, logits [B, 27] or means [B, 3] out; needs --trust); a scripted team\n"
    "(docs/scripted_teams.md; ./circle means a file of that name); or a mixed team, a YAML file that lists such\n"
    "policies, as policies: [runs/first, runs/second]: of its episodes each plays as many, in their order, and the\n"
    "result tells of each (but for --csv). A plays\n"
    "side 0 and B side 1, a checkpoint with its policy of that team; --both-sides also plays the reverse. Where B is "
    "a\n"
    "scripted team and A is not, A plays each side\n"
    "that it has a policy for; an exported policy and a module are for both.\n"
    "The scenario is that of A, else that of B; --scenario plays another, and --set environment.KEY=VALUE changes "
    "keys of\n"
    "it. What a policy observes and how it acts (the keys observation and action) stays as in its training; a game "
    "in\n"
    "which that cannot be is refused with the keys that differ.\n"
    "\n"
    "What a win is, the scenario says (its group win; scenarios show NAME), and the result repeats it. Where it has "
    "no\n"
    "time limit, episodes are cut off after 10,000 steps.\n"
    "A tie is no win. Intervals are Wilson's, 95 %. Steps are 0.1 s; the return is the sum of all rewards of the team "
    "in\n"
    "an episode (mean_return_original: that of the original's evaluator, living agents without the last step), the\n"
    "score counts waypoints. An agent has one cause of death, the first of: out of bounds, collision with an agent, "
    "with\n"
    "an obstacle, damage. Same seed, same result.\n"
    "Examples:\n"
    "  gigastep eval runs/first --vs pursuer\n"
    "  gigastep eval runs/first --vs runs/second --both-sides --episodes 4096 --csv result.csv\n"
    "  gigastep eval runs/first/checkpoints/update_00000100.h5 --vs exported/second --seed 7 --json -\n"
    "  gigastep eval runs/first --vs circle --scenario identical_5_vs_5_fobs\n"
    "  gigastep eval evader --vs pursuer --scenario hide_and_seek_5_vs_5";

}  // namespace

void add_eval_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command =
      app.add_subcommand("eval", "play two against each other: runs, checkpoints, exported policies, scripted teams");
  auto options = std::make_shared<EvalOptions>();
  command->add_option("A", options->a, "checkpoint, run folder, exported policy, TorchScript module or scripted team")
      ->required()
      ->type_name("");
  command->add_option("--vs", options->b, "the opponent, likewise")->required()->check(some_name())->type_name("B");
  command->add_option("--episodes", options->episodes, "episodes per side")
      ->transform(value_of<int>(range(1, 10'000'000)))
      ->capture_default_str()
      ->type_name("N");
  command->add_flag("--both-sides", options->both_sides, "also play A on side 1 against B on side 0");
  command->add_option("--scenario", options->scenario, "scenario to play: name or file")
      ->check(some_name())
      ->type_name("S");
  add_game_changes(*command, options->changes);
  command->add_option("--seed", options->seed, "seed of the episodes: same seed, same result")
      ->transform(value_of<uint64_t>(anything()))
      ->capture_default_str()
      ->type_name("S");
  add_device_option(*command, options->device)->capture_default_str();
  command->add_flag("--greedy", options->greedy,
                    "policies take their most likely action instead of drawing one; those that evolved with "
                    "population.greedy always do");
  command->add_flag(
      "--information", options->information,
      "also measure how much what each policy does depends on what it sees: the mutual information of\n"
      "observation and action in nats, 0 where it always does the same, at most ln 27 = 3.30 (continuous\n"
      "actions: the sum of their three dimensions, each in nine bins); not of mixed teams");
  command->add_flag("--trust", options->trust, "open TorchScript modules, which can run any code");
  command
      ->add_option("--csv", options->csv,
                   "write the result as CSV, a row per side, to a file; - prints it, and nothing else")
      ->check(output(Output::file_or_stdout))
      ->type_name("FILE|-");
  add_json_option(*command, options->json);
  command->footer(kEvalHelp);
  command->callback([options, &dispatch] { dispatch.run = [options] { play(*options); }; });
}

}  // namespace giga
