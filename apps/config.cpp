// gigastep config: prints a run config with all its keys, or what is known about all keys.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/option_value.hpp"
#include "io/schema.hpp"
#include "learn/reference.hpp"
#include "learn/run_config.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

struct ConfigOptions {
  std::string config, schema;
  bool reference = false;
  std::vector<std::string> overrides;
};

std::vector<std::string> kind_names() {
  std::vector<std::string> names;
  for (const FileKind& kind : file_kinds()) names.push_back(kind.name);
  return names;
}

/// Files that a config names, so that it can be read from any folder; those of policies were made whole when it was
/// read.
RunConfig with_whole_paths(const LoadedRun& run) {
  RunConfig config = run.config;
  if (is_path(config.scenario))
    config.scenario = whole_path(file_at(config.scenario, run.scenario_at.value_or(Position{})));
  for_each_file(config.environment, [](Node& path) { path.text = whole_path(file_at(path.text, path.at)); });
  return config;
}

void print_config(const ConfigOptions& o) {
  if (o.reference) {
    std::cout << reference_page();
  } else if (!o.schema.empty()) {
    for (const FileKind& kind : file_kinds())
      if (kind.name == o.schema) write_json(json_schema(kind.defaults, "gigastep " + kind.title), "-");
  } else {
    std::cout << print_yaml(with_whole_paths(load_run_config(find_config(o.config), o.overrides)), true);
  }
}

}  // namespace

void add_config_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("config", "check a config and print it with all keys, defaults and units");
  auto options = std::make_shared<ConfigOptions>();
  CLI::Option* config =
      command
          ->add_option("CONFIG", options->config, "YAML file, or the name of one that comes with gigastep (quickstart)")
          ->type_name("");
  CLI::Option* set = add_set_option(*command, options->overrides);
  CLI::Option* schema =
      command
          ->add_option("--schema", options->schema,
                       "print the JSON schema of a kind of file: run (if none is named), scenario, map, agent_type or "
                       "agent_types")
          ->expected(0, 1)
          ->default_str("run")
          ->transform(value_of<std::string>(one_of(kind_names())))
          ->type_name("[KIND]")
          ->excludes(config)
          ->excludes(set);
  command->add_flag("--reference", options->reference, "print the reference of all keys of all files, as Markdown")
      ->excludes(config)
      ->excludes(set)
      ->excludes(schema);
  command->footer(
      "Prints YAML that reads back to the same config from any folder, a comment at each key. Mistakes are told, all\n"
      "of them, with file, line, column, what is allowed and the nearest name; exit code 2. Whether policies that it\n"
      "names can play is told by train.\n"
      "Examples:\n"
      "  gigastep config quickstart\n"
      "  gigastep config my.yaml --set mappo.gamma=0.995 > resolved.yaml\n"
      "  gigastep config --schema > run.schema.json     editors complete and check with it");
  command->callback([options, config, schema, &dispatch] {
    if (schema->count() > 0 && options->schema.empty()) options->schema = "run";
    if (config->count() == 0 && schema->count() == 0 && !options->reference) throw CLI::RequiredError("CONFIG");
    dispatch.uses_threads = false;
    dispatch.run = [options] { print_config(*options); };
  });
}

}  // namespace giga
