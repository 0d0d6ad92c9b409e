// gigastep scenarios: lists the scenarios, and shows one with all its keys.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "apps/commands.hpp"
#include "apps/output.hpp"
#include "apps/scenario_images.hpp"
#include "apps/scenario_picture.hpp"
#include "core/error.hpp"
#include "io/files.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

int team_size(const std::vector<TeamEntry>& team) {
  int size = 0;
  for (const TeamEntry& entry : team) size += entry.count;
  return size;
}

/// How episodes are won, in a word or two.
std::string won_by(const WinRule& win) {
  return FieldCodec<WinBy>::print(win.by) + (win.at_time_limit == LimitWinner::tie ? "" : " or time");
}

void list() {
  const DataDirs dirs = data_dirs();
  std::printf("%-30s %-14s %11s  %-19s  %s\n", "scenario", "agents", "observation", "won by", "");
  for (const ScenarioInfo& info : list_scenarios(dirs)) {
    const Scenario scenario = load_scenario(info.name, dirs);
    const int n0 = team_size(scenario.team_0), n1 = team_size(scenario.team_1);
    const std::string agents = std::to_string(n0) + " vs " + std::to_string(n1);
    const std::string numbers = std::to_string(compile(scenario).observation_size());
    std::printf("%-30s %-14s %11s  %-19s  %s\n", info.name.c_str(), agents.c_str(), numbers.c_str(),
                won_by(scenario.win).c_str(), info.description.c_str());
  }
}

struct ShowOptions {
  std::string name, picture;
};

void print_or_draw(const ShowOptions& o) {
  const Scenario scenario = load_scenario(o.name, data_dirs());
  const SimSpec spec = compile(scenario);  // what cannot be played is told here already
  if (o.picture.empty()) {
    std::cout << print_scenario(scenario);
    return;
  }
  const std::string ending = std::filesystem::path(o.picture).extension().string();
  if (ending != ".svg" && ending != ".png")
    throw InputError(cat("--picture ", o.picture, ": pictures of maps are SVG, of what agents see PNG: call it ",
                         "FILE.svg or FILE.png"));
  write_output(o.picture, ending == ".svg" ? scenario_picture(spec) : scenario_images(spec));
  std::cout << o.picture << std::endl;
}

}  // namespace

void add_scenarios_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("scenarios", "list the scenarios, or show one");
  command->footer(
      "The list gives agents per team, the numbers in an agent's vector observation, and by what episodes are won;\n"
      "`show` begins with what a win is, in words.\n"
      "Examples:\n"
      "  gigastep scenarios\n"
      "  gigastep scenarios show identical_5_vs_5           all keys with values, units and defaults, as YAML\n"
      "  gigastep scenarios show identical_5_vs_5_fobs_void variants by suffix: _fobs|_pobs, _rgb|_vec, _maps|_void,\n"
      "                                                     _cont|_disc, in any order");
  command->callback([command, &dispatch] {
    if (command->get_subcommands().empty()) dispatch.run = list;
    dispatch.uses_threads = false;
  });

  CLI::App* show = command->add_subcommand("show", "print a scenario resolved, as YAML that can be changed and used");
  auto options = std::make_shared<ShowOptions>();
  show->add_option("NAME", options->name, "name, with suffixes if wanted, or path of a scenario file")
      ->required()
      ->type_name("");
  show->add_option(
          "--picture", options->picture,
          "draw its maps instead, with where the teams start, and how far agents see and shoot; or, as PNG, the\n"
          "images that agents are given (_rgb) some seconds into a game")
      ->check(output(Output::file))
      ->type_name("FILE.svg|png");
  show->footer(
      "Examples:\n"
      "  gigastep scenarios show hide_and_seek_5_vs_5 > mine.yaml\n"
      "  gigastep scenarios show ./mine.yaml --picture mine.svg     any browser shows it\n"
      "  gigastep scenarios show identical_5_vs_5_rgb --picture seen.png");
  show->callback([options, &dispatch] {
    dispatch.uses_threads = false;
    dispatch.run = [options] { print_or_draw(*options); };
  });
}

}  // namespace giga
