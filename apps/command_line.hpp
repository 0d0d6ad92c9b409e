// What all commands share on the command line: general help, options that several have, and hints after mistakes.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
class Error;
class Option;
}  // namespace CLI

namespace giga {

/// Version, exit codes, examples.
void describe_program(CLI::App& app);

CLI::Option* add_device_option(CLI::App& command, std::string& device);
CLI::Option* add_set_option(CLI::App& command, std::vector<std::string>& overrides);
/// --set of who plays a game: assignments "environment.KEY=VALUE".
CLI::Option* add_game_changes(CLI::App& command, std::vector<std::string>& changes);
/// --quiet and --no-color.
void add_display_options(CLI::App& command, bool& quiet, bool& no_color);
CLI::Option* add_json_option(CLI::App& command, std::string& destination);

/// `help COMMAND` is `COMMAND --help`; other lines stay as they are. Throws InputError where there is no such command.
std::vector<std::string> help_in_words(const CLI::App& app, std::vector<std::string> arguments);

/// The message for a line that was not understood: what is wrong, the nearest name, where help is.
std::string explain(const CLI::App& app, const CLI::Error& error);

/// The file of a run config: a path, or the bare name of one that comes with gigastep ("quickstart"). Throws
/// InputError.
std::string find_config(const std::string& path_or_name);

}  // namespace giga
