// gigastep play: writes a page in which a person flies an agent with and against trained teams.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/known_rating.hpp"
#include "apps/load_player.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/players.hpp"
#include "apps/program_info.hpp"
#include "core/error.hpp"
#include "eval/played_game.hpp"
#include "eval/record.hpp"
#include "export/export.hpp"
#include "io/files.hpp"
#include "io/run_folder.hpp"
#include "learn/players/player.hpp"
#include "play/page.hpp"
#include "play/plain_actor.hpp"
#include "policy/actor.hpp"
#include "rating/sheet.hpp"

namespace giga {
namespace {
namespace fs = std::filesystem;

constexpr int kMostAgents = 200;  // with more of them a page does not keep up

struct PlayOptions {
  std::string a, b, out = "play", folder;
  std::vector<std::string> scenarios, changes;
  int levels = 3;
  bool greedy = false;
};

/// Somebody to play with or against, and how strong; NaN where nobody has rated it, infinite where it won all or lost
/// all.
struct Level {
  Player player;
  double rating;
};

/// Of its first team where the teams were rated apart; of the only one that learned. Ratings of a changed game do not
/// count.
double rating_of(const fs::path& run, int64_t updates) {
  const Json found = known_rating({run, updates}, "the page names no ratings");
  if (const auto changes = found.find("changes"); changes != found.end() && !changes->empty()) return NAN;
  const auto at = found.find("rating"), standing = found.find("standing");
  if (at != found.end() && at->is_number()) return at->get<double>();
  if (standing != found.end() && *standing == name_of(Standing::above)) return INFINITY;
  return standing != found.end() && *standing == name_of(Standing::below) ? -INFINITY : NAN;
}

/// Of a run its best policy, and earlier ones as weaker levels, the strongest first; of all others the one that is
/// named.
std::vector<Level> levels_of(const std::string& text, int most, const PlayerOptions& options) {
  std::vector<Level> levels;
  levels.push_back({load_player(text, options), NAN});
  if (levels[0].player.is_mixed())
    throw InputError(cat(text, " is a mixed team, which a page does not have; name one who plays in it"));
  std::error_code code;
  if (find_script(text) || !fs::is_directory(text, code) || is_exported_policy(text)) return levels;
  const auto label = [&](Level& level) {
    const Player::Origin& origin = *level.player.origin();
    level.rating = rating_of(text, origin.updates);
    std::string name =
        cat(name_of_folder(text), " after ", counted(origin.updates, algorithm_of(origin.run.config).updates));
    if (std::isfinite(level.rating)) name += cat(", rated ", std::lround(level.rating));
    level.player.rename(name);
  };
  label(levels[0]);
  const int64_t best = levels[0].player.origin()->updates;
  std::vector<fs::path> files = list_checkpoints(text);
  for (const size_t k : spread(files.size(), static_cast<size_t>(most))) {
    if (static_cast<int>(levels.size()) == most) break;
    std::optional<Checkpoint> checkpoint = read_if_whole(files[k]);
    if (!checkpoint) continue;
    Level level{Player::of_checkpoint({files[k], std::move(*checkpoint), {}, {}}, options), NAN};
    if (level.player.origin()->updates == best) continue;
    label(level);
    levels.push_back(std::move(level));
  }
  const auto strength = [](const Level& level) {
    return std::pair(std::isnan(level.rating) ? -INFINITY : level.rating, level.player.origin()->updates);
  };
  if (static_cast<int>(levels.size()) < most)
    std::cerr << "note: " << text << " has " << counted(static_cast<int64_t>(levels.size()), "levels") << ", not "
              << most << ": the run has no more checkpoints\n";
  // What was named comes first; the others by rating, or where there is none by how long they learned.
  std::stable_sort(levels.begin() + 1, levels.end(),
                   [&](const Level& x, const Level& y) { return strength(x) > strength(y); });
  return levels;
}

/// Collects the players of a page: each network once.
class PagePlayers {
 public:
  /// `greedy`: all policies take their most likely action.
  PagePlayers(PlayPage& page, bool greedy) : page_(page), greedy_(greedy) {}

  /// Both return the number of the player on the page.
  int add_script(Scripted script) {
    const int who = network_of_script(script);
    return add({name_of(script), {who, who}}, nullptr);
  }
  int add(Player& player, const std::string& name) { return add({name, {}}, &player); }
  /// Who can play team `team` of a scenario. Their networks are put on the page.
  std::vector<int> able(int team, const SimSpec& spec) {
    std::vector<int> all;
    for (size_t k = 0; k < loaded_.size(); ++k)
      if (!loaded_[k] || take(k, team, spec)) all.push_back(static_cast<int>(k));
    return all;
  }

 private:
  int add(const PagePlayer& shown, Player* player) {
    page_.players.push_back(shown);
    loaded_.push_back(player);
    return static_cast<int>(loaded_.size()) - 1;
  }
  bool take(size_t number, int team, const SimSpec& spec) {
    Player& player = *loaded_[number];
    if (!player.can_play(team)) return false;
    const std::unique_ptr<TeamController> controller = player.controller(team, spec);  // throws where it does not fit
    const auto* actor = dynamic_cast<const Actor*>(player.mind(team, spec).policy);
    if (!actor && player.computes_view())
      throw InputError(cat(player.name(),
                           " computes the egocentric view itself where a game does not offer that of its "
                           "training, and a page cannot: play the run that it is of, or '",
                           spec.name, "' as it was in training"));
    if (!actor)
      throw InputError(cat(player.name(),
                           " is a TorchScript module, which a page cannot run: play a run, a checkpoint "
                           "or a safetensors export"));
    // An exported policy is the same for both teams.
    const int network_of = player.mind(0, spec).policy == actor ? 0 : team;
    const auto [at, is_new] = networks_.try_emplace({number, network_of}, static_cast<int>(page_.networks.size()));
    if (is_new) {
      const bool greedy = greedy_ || (player.origin() && acts_greedily(player.origin()->run.config));
      // One that would compute the egocentric view reads that of the page.
      const SimSpec seen = player.computes_view() ? spec : player.seen_by(spec);
      page_.networks.push_back(plain_network_of(*actor, seen.observation_size(), greedy));
    }
    page_.players[number].who[static_cast<size_t>(team)] = at->second;
    return true;
  }

  PlayPage& page_;
  const bool greedy_;
  std::vector<Player*> loaded_;  // [players] null: a script
  std::map<std::pair<size_t, int>, int> networks_;
};

void write(const PlayOptions& o) {
  const PlayerOptions loading{Device{}, false, o.greedy};
  std::vector<Level> levels = levels_of(o.a, o.levels, loading);
  if (!has_play_module()) throw InputError(kNoPlayModule);  // mistakes of the user first
  std::vector<Level> others;
  if (!o.b.empty() && o.b != o.a) others = levels_of(o.b, o.levels, loading);
  const std::string first = levels[0].player.name(), against = (others.empty() ? levels : others)[0].player.name();
  PlayPage page;
  page.version = program_version();
  page.title = first == against ? first : cat(first, " and ", against);
  page.about = "You fly one agent; trained policies and scripts fly the others.";
  PagePlayers players(page, o.greedy);
  std::vector<const Player*> all;
  const auto add = [&](std::vector<Level>& group, const std::string& source) {
    int own = -1;  // the first of them among the page's players; scripts come behind all others
    for (Level& level : group) {
      all.push_back(&level.player);
      if (level.player.script()) continue;
      const auto shows = [&](const PagePlayer& p) { return p.name == level.player.name(); };
      const bool taken = std::any_of(page.players.begin(), page.players.end(), shows);
      const int number = players.add(level.player, level.player.name() + (taken ? cat(" (", source, ")") : ""));
      if (own < 0) own = number;
    }
    return own;
  };
  const int mates = add(levels, o.a), opponents = others.empty() ? mates : add(others, o.b);
  const int scripts = static_cast<int>(page.players.size());
  for (size_t k = 0; k < enum_names(Scripted{}).size(); ++k) players.add_script(static_cast<Scripted>(k));
  const auto number_of = [scripts](int number, const std::optional<Scripted>& script) {
    return number >= 0 ? number : scripts + static_cast<int>(script.value());
  };
  page.mates = number_of(mates, find_script(o.a));
  page.opponents = number_of(opponents, find_script(others.empty() ? o.a : o.b));

  if (o.folder.empty()) expect_output(Output::stem, o.out, "--out takes another name");  // it may be the default
  std::vector<std::string> scenarios = o.scenarios;
  if (scenarios.empty()) scenarios.emplace_back();
  if (std::set<std::string>(scenarios.begin(), scenarios.end()).size() < scenarios.size())
    throw InputError("--scenario: one is named twice");
  for (const std::string& name : scenarios) {
    PlayedGame game = choose_game({name, o.changes}, all, OtherGames::allowed);
    for (const std::string& note : game.notes) std::cerr << "note: " << note << '\n';
    if (game.spec.params.n_agents > kMostAgents)
      throw InputError(cat("'", game.spec.name, "' has ", game.spec.params.n_agents, " agents; allowed are at most ",
                           kMostAgents, ", so that a page keeps up"));
    PageScenario& scenario = page.scenarios.emplace_back();
    scenario.name = game.spec.name;
    scenario.spec = game.spec;
    scenario.frame = replay_frame(game.scenario, game.spec, page.version);
    for (int team = 0; team < kNTeams; ++team)
      scenario.players[static_cast<size_t>(team)] = players.able(team, game.spec);
  }

  if (!o.folder.empty()) {
    write_play_folder(o.folder, page);
    std::cout << o.folder << ": for a web server, as python3 -m http.server --directory " << shell_word(o.folder)
              << std::endl;
    return;
  }
  fs::path out = o.out;
  if (out.filename().empty()) throw InputError(cat("--out ", o.out, " names no file"));
  if (out.extension() != ".html") out += ".html";
  const std::string text = play_page(page);
  write_output(out, text);
  std::cout << out.string() << ": " << (text.size() + 512) / 1024 << " KB; open it in a browser" << std::endl;
}

const char* const kPlayHelp =
    "POLICY flies your mates, and your opponents too unless --vs names others: runs, checkpoints, exported policies "
    "(safetensors),\n"
    "scripted teams; policies read numbers, not images. All scripts can be chosen on the page, and of a run folder "
    "earlier checkpoints too, as weaker "
    "levels.\n"
    "The page computes the same numbers as the trainer, so a game that it saves can be watched (`gigastep picture`) "
    "and "
    "checked\n"
    "(`gigastep record --verify`).\n"
    "Examples:\n"
    "  gigastep play runs/first\n"
    "  gigastep play runs/first --vs pursuer --scenario identical_5_vs_5 --scenario identical_5_vs_5_fobs --out "
    "game.html\n"
    "  gigastep play circle --vs evader --scenario hide_and_seek_5_vs_5 --folder site";

}  // namespace

void add_play_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("play", "write a page in which you fly with and against trained teams");
  auto options = std::make_shared<PlayOptions>();
  command->add_option("POLICY", options->a, "who flies with you: run, checkpoint, exported policy, script")
      ->required()
      ->type_name("");
  command->add_option("--vs", options->b, "who flies against you; default: POLICY")
      ->check(some_name())
      ->type_name("POLICY");
  command->add_option("--scenario", options->scenarios, "scenario to play: name or file; may be given several times")
      ->type_name("S")
      ->take_all()
      ->allow_extra_args(false);
  add_game_changes(*command, options->changes);
  command->add_option("--levels", options->levels, "of a run folder: checkpoints to choose from, the best included")
      ->transform(value_of<int>(range(1, 20)))
      ->capture_default_str()
      ->type_name("N");
  command->add_flag("--greedy", options->greedy, "policies take their most likely action instead of drawing one");
  CLI::Option* out = command->add_option("--out", options->out, "file to write")
                         ->check(output(Output::stem))
                         ->capture_default_str()
                         ->type_name("FILE");
  command->add_option("--folder", options->folder, "write a folder for a web server instead")
      ->check(output(Output::folder))
      ->type_name("DIR")
      ->excludes(out);
  command->footer(kPlayHelp);
  command->callback([options, &dispatch] { dispatch.run = [options] { write(*options); }; });
}

}  // namespace giga
