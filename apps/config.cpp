// gigastep config: prints a run config with all its keys.
#include <CLI/CLI.hpp>
#include <iostream>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "learn/run_config.hpp"

namespace giga {

void add_config_command(CLI::App& app, Dispatch& dispatch) {
  struct Options {
    std::string config;
    std::vector<std::string> overrides;
  };
  CLI::App* command = app.add_subcommand("config", "check a config and print it with all keys, defaults and units");
  auto options = std::make_shared<Options>();
  command->add_option("CONFIG", options->config, "YAML file, or the name of one that comes with gigastep (quickstart)")
      ->required()
      ->type_name("");
  add_set_option(*command, options->overrides);
  command->footer(
      "Prints YAML that reads back to the same config, a comment at each key. A mistake is told with file, line, "
      "column,\n"
      "what is allowed and the nearest name; exit code 2.\n"
      "Examples:\n"
      "  gigastep config quickstart\n"
      "  gigastep config my.yaml --set mappo.gamma=0.995 > resolved.yaml");
  command->callback([options, &dispatch] {
    dispatch.run = [options] {
      const LoadedRun run = load_run_config(find_config(options->config), options->overrides);
      std::cout << print_yaml(run.config, true);
    };
  });
}

}  // namespace giga
