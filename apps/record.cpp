// gigastep record: plays games and keeps them as a replay and as a page that shows them; or checks a replay.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/load_player.hpp"
#include "apps/match_note.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "core/error.hpp"
#include "core/seeds.hpp"
#include "cuda/runtime.hpp"
#include "eval/played_game.hpp"
#include "eval/record.hpp"
#include "io/files.hpp"
#include "watch/page.hpp"

namespace giga {
namespace {
namespace fs = std::filesystem;

struct RecordOptions {
  std::string a, b, beside, scenario, device = "auto", out = "game", verify;
  std::vector<std::string> changes;
  int episodes = 4;
  uint64_t seed = 0;
  bool greedy = false, trust = false;
};

RecordedTeam team_of(Player& player, int side, const SimSpec& spec) {
  RecordedTeam team;
  team.controller = player.controller(side, spec);
  team.mind = player.mind(side, spec);
  team.name = player.name();
  for (const Player* member : player.members())
    if (const Player::Origin* origin = member->origin())
      team.origin += cat(team.origin.empty() ? "" : "; ", origin->file, ", after ",
                         counted(origin->updates, algorithm_of(origin->run.config).updates));
  return team;
}

/// `out` without an ending that stands for what is written.
fs::path stem_of(const std::string& out) {
  fs::path path = out;
  if (path.extension() == kReplayEnding || path.extension() == ".html") path.replace_extension();
  if (path.filename().empty()) throw InputError(cat("--out ", out, " names no file"));
  return path;
}

void record(const RecordOptions& o) {
  if (o.a.empty()) throw InputError("A is missing: who plays (gigastep record --help), or --verify FILE");
  const fs::path stem = stem_of(o.out);
  expect_output(Output::stem, o.out, "--out takes another name");  // the default is not looked at with the options
  const Device device = parse_device(o.device);
  const PlayerOptions loading{device, o.trust, o.greedy};
  std::vector<Player> players;
  players.push_back(load_player(o.a, loading));
  players.push_back(o.b.empty() ? Player::load(o.a, loading) : load_player(o.b, loading));
  if (!o.beside.empty()) players.push_back(load_player(o.beside, loading));
  std::vector<const Player*> all;
  for (const Player& player : players) all.push_back(&player);
  if (o.b.empty() && !players[0].can_play(1))
    throw InputError(cat(players[0].name(),
                         " has no policy for side 1, where it would play against itself; --vs says "
                         "against whom it plays (allowed: a run, a policy, a script)"));
  const PlayedGame game = choose_game({o.scenario, o.changes}, all, OtherGames::allowed);
  for (const std::string& note : game.notes) std::cerr << "note: " << note << '\n';
  const int n_threads = game.spec.params.n_agents > kMaxAgents ? 0 : 1;  // games are few; the agents of a crowd are not
  const MatchOptions options{o.episodes, seed_of(o.seed, Purpose::eval), device, n_threads, note_once()};

  std::vector<std::string> replays;
  std::vector<RecordedTeam> teams;  // before the first match: who cannot play is told at once
  check_episodes(o.episodes, players);
  for (size_t k = 0; k < players.size(); ++k) teams.push_back(team_of(players[k], k == 1 ? 1 : 0, game.spec));
  for (size_t k = 0; k < players.size(); ++k) {
    if (k == 1) continue;  // the opponent
    RecordedMatch match = record_match(game.scenario, game.spec, {teams[k], teams[1]}, options, program_version());
    fs::path file = stem;
    file += cat(k == 0 ? "" : "_beside", kReplayEnding);
    const std::string bytes = encode_replay(match.replay);
    write_output(file, bytes);
    const MatchResult& r = match.result;
    std::cout << file.string() << ": " << players[k].name() << " against " << players[1].name() << ", "
              << counted(r.episodes, "episodes") << ", " << (bytes.size() + 512) / 1024 << " KB; team 0 wins "
              << r.wins[0] << ", team 1 " << r.wins[1] << ", ties " << r.ties << '\n';
    replays.push_back(bytes);
  }
  fs::path page = stem;
  page += ".html";
  const std::string beside = o.beside.empty() ? "" : cat(" and ", players[2].name());
  write_output(page,
               watch_page(replays, cat(players[0].name(), beside, " against ", players[1].name()), program_version()));
  std::cout << page.string() << ": open it in a browser" << std::endl;
}

int verify(const RecordOptions& o) {
  const Replay replay = decode_replay(read_file(o.verify), o.verify);
  const std::string difference = verify_replay(replay, parse_device(o.device));
  if (difference.empty()) {
    const size_t n = replay.episodes.size();
    std::cout << o.verify << ": played again, " << (n == 1 ? "its one episode is" : cat("all ", n, " episodes are"))
              << " the same bit for bit\n";
    return 0;
  }
  std::cout << o.verify << ": " << difference << "; it was written by gigastep " << replay.gigastep_version
            << ", this is " << program_version() << '\n';
  return 1;
}

const char* const kRecordHelp =
    "A and B are named as for `gigastep eval`: runs, checkpoints, exported policies, scripted or mixed teams. A plays "
    "side "
    "0 and B\n"
    "side 1. Episode k is the same game as episode k of `eval` with the same seed; who plays it in a mixed team\n"
    "depends on how many there are.\n"
    "Written are FILE.replay, which programs read (docs/replays.md; examples/read_replay.py), and FILE.html, a page "
    "that opens\n"
    "in any browser and needs no network. With --beside C the page shows C against B next to A against B, from the "
    "same\n"
    "starts; that replay is FILE_beside.replay.\n"
    "--verify plays a replay again from its actions and seed and compares all states bit for bit: exit code 0 where "
    "all "
    "are\n"
    "the same, 1 where not.\n"
    "Examples:\n"
    "  gigastep record runs/first --vs circle --out game\n"
    "  gigastep record runs/first --vs pursuer --beside runs/second --episodes 2 --out compare\n"
    "  gigastep record --verify game.replay";

}  // namespace

void add_record_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command =
      app.add_subcommand("record", "play games and keep them as a replay, and as a page that shows them");
  auto options = std::make_shared<RecordOptions>();
  CLI::Option* a =
      command->add_option("A", options->a, "who plays side 0: run, checkpoint, exported policy, script")->type_name("");
  command->add_option("--vs", options->b, "who plays side 1; default: A")->check(some_name())->type_name("B");
  command->add_option("--beside", options->beside, "another who plays side 0 from the same starts")
      ->check(some_name())
      ->type_name("C");
  command->add_option("--episodes", options->episodes, "games")
      ->transform(value_of<int>(range(1, 1000)))
      ->capture_default_str()
      ->type_name("N");
  command->add_option("--scenario", options->scenario, "scenario to play: name or file")
      ->check(some_name())
      ->type_name("S");
  add_game_changes(*command, options->changes);
  command->add_option("--seed", options->seed, "seed of the episodes: same seed, same games")
      ->transform(value_of<uint64_t>(anything()))
      ->capture_default_str()
      ->type_name("S");
  CLI::Option* device = add_device_option(*command, options->device)->capture_default_str();
  command->add_flag("--greedy", options->greedy, "policies take their most likely action instead of drawing one");
  command->add_flag("--trust", options->trust, "open TorchScript modules, which can run any code");
  command->add_option("--out", options->out, "files to write, without ending")
      ->check(output(Output::stem))
      ->capture_default_str()
      ->type_name("FILE");
  CLI::Option* verify_option = command->add_option("--verify", options->verify, "only check this replay")
                                   ->check(some_name())
                                   ->type_name("FILE")
                                   ->excludes(a);
  for (CLI::Option* other : command->get_options())  // the replay says who plays what
    if (other != verify_option && other != command->get_help_ptr() && other != device) verify_option->excludes(other);
  command->footer(kRecordHelp);
  command->callback([options, &dispatch] {
    dispatch.run = [options, &dispatch] {
      if (options->verify.empty()) return record(*options);
      dispatch.exit_code = verify(*options);
    };
  });
}

}  // namespace giga
