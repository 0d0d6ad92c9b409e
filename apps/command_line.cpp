// General help, shared options, and hints after mistakes.
#include "apps/command_line.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>

#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "scenario/data_dirs.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

/// The command that the line named, or the program itself.
const CLI::App& deepest_command(const CLI::App& app) {
  const std::vector<CLI::App*> commands = app.get_subcommands();
  return commands.empty() ? app : deepest_command(*commands.front());
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  return names;
}

std::vector<std::string> command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; }))
    names.push_back(command->get_name());
  return names;
}

/// As a shell takes it: in quotes where it has blanks or brackets.
std::string quoted(const std::string& assignment) {
  return assignment.find_first_of(" []{}*?") == std::string::npos ? assignment : "'" + assignment + "'";
}

/// The right form of a setting that was written in another way: `--set KEY VALUE`, `--KEY=VALUE`, a list that the shell
/// took apart; empty where it is none of these. `word` is the first one that was not understood.
std::string explain_setting(const CLI::App& command, const std::string& word) {
  if (!command.get_option_no_throw("--set")) return "";
  const auto write = [](const std::string& assignment) { return "; write --set " + quoted(assignment); };
  if (word.starts_with("--") && word.find('.') < word.find('=')) {
    const bool whole = word.find('=') != std::string::npos;
    const std::vector<std::string> rest = command.remaining();
    const std::string value = whole ? "" : cat("=", rest.size() > 1 ? rest[1] : "VALUE");
    return cat("unknown option '", word, "'", write(word.substr(2) + value));
  }
  const auto words = command_line().get<std::vector<std::string>>();
  for (size_t k = 0; k + 2 < words.size(); ++k) {
    if (words[k] != "--set") continue;
    const std::string &assignment = words[k + 1], &next = words[k + 2];
    if (assignment.find('=') == std::string::npos && !next.starts_with("-")) {
      const bool apart = next == "=" && k + 3 < words.size();  // KEY = VALUE
      return cat("--set ", assignment, " ", next, ": expected KEY=VALUE",
                 write(assignment + "=" + (apart ? words[k + 3] : next)));
    }
    if (std::count(assignment.begin(), assignment.end(), '[') <= std::count(assignment.begin(), assignment.end(), ']'))
      continue;
    std::string list = assignment;
    for (size_t n = k + 2; n < words.size() && list.find(']') == std::string::npos; ++n) list += " " + words[n];
    return cat("--set ", assignment, ": the shell took the list apart at its blanks", write(list));
  }
  return "";
}

/// Whether `scenarios show` has something to say of a word.
bool names_scenario(const std::string& word) {
  std::error_code code;
  if (is_path(word) && fs::is_regular_file(word, code)) return true;  // which may have mistakes
  try {
    load_scenario(word, data_dirs());
    return true;
  } catch (const InputError&) {
    return false;
  }
}

/// What is wrong with the first word that was not understood; empty where there is none.
std::string explain_leftover(const CLI::App& command) {
  const std::vector<std::string> leftover = command.remaining();
  if (leftover.empty()) return "";
  const std::string& word = leftover.front();
  if (const std::string hint = explain_setting(command, word); !hint.empty()) return hint;
  const std::vector<std::string> commands = command_names(command);
  if (word.rfind('-', 0) == 0) {
    const std::string name = word.substr(0, word.find('='));
    if ((name == "--out" || name == "--output" || name == "--dir") && command.get_option_no_throw("--run-dir"))
      return cat("unknown option '", name, "'; the folder of the run is --run-dir");
    const std::string hint = nearest_hint(name, option_names(command));
    const bool has_keys = hint.empty() && command.get_option_no_throw("--set");
    return cat("unknown option '", name, "'", has_keys ? "; keys are set by --set KEY=VALUE" : hint);
  }
  const std::string nearest = nearest_hint(word, commands);
  if (command.get_name() == "scenarios" && nearest.empty() && names_scenario(word))
    return cat("unexpected argument '", word, "'; write scenarios show ", word);
  if (!commands.empty()) return cat("unknown command '", word, "'", nearest, "; commands: ", join(commands));
  return cat("unexpected argument '", word, "'");
}

}  // namespace

void describe_program(CLI::App& app) {
  app.set_version_flag("--version", program_version(), "print the version and exit");
  app.set_help_flag("-h,--help", "print help and exit; each command has its own");
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  gigastep train quickstart                 train two teams; at the end it says where everything is\n"
      "  gigastep resume runs/NAME                 go on with a run that was stopped\n"
      "  gigastep eval runs/NAME --vs circle       win rates of both teams of a run\n"
      "  gigastep scenarios                        what can be played\n"
      "  gigastep bench sim --worlds 1024          how fast it is here\n"
      "\n"
      "Exit codes: 0 done; 1 failed; 2 the command line, a file or a value is wrong; 3 training diverged. Training "
      "that\n"
      "was stopped with its state saved: 130 by SIGINT, 143 by SIGTERM, 138 by SIGUSR1, 129 by SIGHUP, 124 by\n"
      "train.max_wall_time or train.stop_at_agent_steps.\n"
      "Environment: GIGASTEP_DATA_DIR=<dir> is searched first for scenarios/ and configs/.");
}

CLI::Option* add_device_option(CLI::App& command, std::string& device) {
  return command
      .add_option("--device", device, "auto (the first GPU, else the CPU), cpu, cuda or cuda:<number of the GPU>")
      ->check(some_name())
      ->type_name("DEVICE");
}

CLI::Option* add_set_option(CLI::App& command, std::vector<std::string>& overrides) {
  return command
      .add_option(
          "--set", overrides,
          "change a key, as --set train.n_worlds=512; may be given several times: the last of a key counts, and a "
          "group ({...}) takes the place of the whole group")
      ->type_name("KEY=VALUE")
      ->take_all()
      ->allow_extra_args(false);
}

CLI::Option* add_game_changes(CLI::App& command, std::vector<std::string>& changes) {
  return command
      .add_option(
          "--set", changes,
          "change a key of the scenario, as --set environment.sight.cone_depth=5; may be given several times: the "
          "last of a key counts")
      ->type_name("environment.KEY=VALUE")
      ->take_all()
      ->allow_extra_args(false);
}

void add_display_options(CLI::App& command, bool& quiet, bool& no_color) {
  command.add_flag("--quiet", quiet, "no progress; warnings, errors and the final table only");
  command.add_flag("--no-color", no_color, "no colours on the terminal, as with NO_COLOR in the environment");
}

CLI::Option* add_json_option(CLI::App& command, std::string& destination) {
  return command.add_option("--json", destination, "write the result as JSON to a file; - prints it, and nothing else")
      ->check(output(Output::file_or_stdout))
      ->type_name("FILE|-");
}

std::vector<std::string> help_in_words(const CLI::App& app, std::vector<std::string> arguments) {
  if (arguments.empty() || arguments.front() != "help") return arguments;
  arguments.erase(arguments.begin());
  const CLI::App* command = &app;
  for (const std::string& word : arguments) {
    if (word.starts_with("-")) break;
    const std::vector<std::string> names = command_names(*command);
    if (std::find(names.begin(), names.end(), word) == names.end())
      throw InputError(cat("there is no help for '", word, "'", nearest_hint(word, names),
                           "; commands: ", join(command_names(names.empty() ? app : *command))));
    command = command->get_subcommand(word);
  }
  arguments.emplace_back("--help");
  return arguments;
}

std::string explain(const CLI::App& app, const CLI::Error& error) {
  const CLI::App& command = deepest_command(app);
  std::string message = explain_leftover(command);
  if (message.empty() && command.get_require_subcommand_min() > 0 && command.get_subcommands().empty())
    message = "no command given; commands: " + join(command_names(command));
  if (message.empty()) message = error.what();
  // "--vs: 1 required B missing"
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) && message.ends_with(" missing"))
    message = message.substr(0, message.find(": ")) + ": a value is missing";
  // "--name excludes --run-dir"
  constexpr std::string_view kExcludes = " excludes ";
  if (const size_t at = message.find(kExcludes); dynamic_cast<const CLI::ExcludesError*>(&error) && at != message.npos)
    message.replace(at, kExcludes.size(), " cannot be given together with ");
  std::string name = command.get_name();
  for (const CLI::App* parent = command.get_parent(); parent; parent = parent->get_parent())
    name = parent->get_name() + " " + name;
  return cat(message, "\nFor help: ", name, " --help");
}

std::string find_config(const std::string& path_or_name) {
  std::error_code code;
  if (fs::is_regular_file(path_or_name, code)) return path_or_name;
  const fs::path asked = path_or_name;
  if (fs::is_directory(asked, code) && fs::is_regular_file(asked / "config.yaml", code))
    throw InputError(cat(path_or_name,
                         ": this is the folder of a run, not a config; to go on with it: ", program_command(),
                         " resume ", shell_word(path_or_name), "; to train the same again: ", program_command(),
                         " train ", shell_word((asked / "config.yaml").string())));
  if (asked.has_parent_path() && fs::is_directory(asked, code))
    throw InputError(cat(path_or_name, ": is a folder, not a config"));
  const DataDirs dirs = data_dirs();
  const bool bare = !asked.has_parent_path() && asked.extension() != ".yaml";
  const fs::path relative = bare ? fs::path("configs") / (path_or_name + ".yaml") : asked;
  if (asked.is_relative())
    if (const auto found = find_data_file(dirs, relative)) return found->string();
  const std::vector<std::string> known = data_names(dirs, "configs");
  throw InputError(cat("there is no config ", path_or_name, nearest_hint(asked.stem().string(), known),
                       "; those that come with gigastep: ", join(known)));
}

}  // namespace giga
