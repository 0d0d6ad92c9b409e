// gigastep export: writes the policy of a team for use in other programs, with a manifest and an example.
#include <CLI/CLI.hpp>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/commands.hpp"
#include "apps/known_rating.hpp"
#include "apps/option_value.hpp"
#include "apps/output.hpp"
#include "apps/program_info.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "export/export.hpp"
#include "io/run_folder.hpp"
#include "learn/players/policies.hpp"
#include "policy/actor.hpp"
#include "rating/sheet.hpp"

namespace giga {
namespace {

struct ExportRequest {
  std::string checkpoint, format, out, view = "inside";
  int team = 0;
};

template <class Choice>
Choice parse_choice(const char* what, const std::string& name) {
  const std::vector<std::string> names = FieldCodec<Choice>::names();
  for (size_t k = 0; k < names.size(); ++k)
    if (name == names[k]) return static_cast<Choice>(k);
  throw InputError(cat(what, " '", name, "' is unknown", nearest_hint(name, names), "; allowed: ", join(names)));
}

PolicyOrigin origin_of(const Checkpoint& c, const LoadedRun& run, int team) {
  PolicyOrigin origin;
  origin.gigastep_version = program_version();
  origin.scenario_name = c.scenario_name;
  origin.scenario_yaml = c.scenario_yaml;
  origin.config_yaml = c.config_yaml;
  origin.team = team;
  origin.seed = c.seed;
  origin.updates = c.updates;
  origin.agent_steps = c.agent_steps;
  origin.precision = run.config.train.precision;
  origin.selection = acts_greedily(run.config) ? ActionSelection::greedy : ActionSelection::sampled;
  return origin;
}

void export_policy(const ExportRequest& o) {
  // A wrong name is told before anything is read.
  const auto format = parse_choice<ExportFormat>("format", o.format);
  const auto view = parse_choice<ViewPlace>("view", o.view);
  const FoundCheckpoint found = find_best_checkpoint(o.checkpoint);
  const std::string file = found.file.string();
  for (const std::string& line : found.damaged) std::cerr << "warning: " << line << "; " << file << " is taken\n";
  const Checkpoint& checkpoint = found.checkpoint;
  const LoadedPolicies loaded =
      load_policies(checkpoint.config_yaml, checkpoint.scenario_yaml, checkpoint.arrays, Device{});
  const Actor* actor = loaded.actor[o.team].get();
  if (!actor)
    throw InputError(cat("team ", o.team, " of ", file, " has no learned policy: it did not learn in training; team ",
                         1 - o.team, " has one"));
  if (view == ViewPlace::input && !(loaded.run.spec.params.egocentric_view && !actor->reads_image()))
    throw InputError(cat("--view input: the policy of team ", o.team, " of ", file,
                         " does not read the egocentric view, so that it has no place"));
  const std::filesystem::path run =
      std::filesystem::absolute(found.file).lexically_normal().parent_path().parent_path();
  const Json ratings = known_rating({run, checkpoint.updates, o.team}, "the manifest has no ratings");
  write_export(o.out, format, *actor, loaded.run.spec, origin_of(checkpoint, loaded.run, o.team), {view, &ratings});
  std::cout << o.out << ": the policy of team " << o.team << " after "
            << counted(checkpoint.updates, algorithm_of(loaded.run.config).updates) << " in "
            << checkpoint.scenario_name << "\ntry it: python3 "
            << shell_word((std::filesystem::path(o.out) / kExampleName).string())
            << " (its first lines say which packages it needs)" << std::endl;
}

}  // namespace

void add_export_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("export", "write the policy of a team for use in other programs");
  auto options = std::make_shared<ExportRequest>();
  command
      ->add_option("CHECKPOINT", options->checkpoint,
                   "checkpoint file, or run folder (its best checkpoint, or its newest if none is called best)")
      ->required()
      ->type_name("");
  command->add_option("--team", options->team, "whose policy: 0 or 1")
      ->required()
      ->transform(value_of<int>(range(0, 1)))
      ->type_name("T");
  command
      ->add_option("--format", options->format,
                   "safetensors (tensors alone; plays here again), onnx (a graph; is not read here) or torchscript (a "
                   "module; legacy: PyTorch develops it no further)")
      ->required()
      ->type_name("FORMAT");
  command
      ->add_option("--view", options->view,
                   "of policies that read the egocentric view: inside (default): the policy computes it and takes the "
                   "vector observation alone, the original's; input: the view is part of its observation")
      ->type_name("PLACE");
  command->add_option("--out", options->out, "folder to be made; it must not exist or be empty")
      ->required()
      ->check(output(Output::folder))
      ->type_name("DIR");
  command->footer(
      "DIR gets the policy (policy.safetensors, policy.onnx or policy.pt; the normalisation of observations is part "
      "of\n"
      "it), manifest.json (architecture, observation layout number by number, actions, scenario, ratings, training) "
      "and "
      "act.py,\n"
      "an example in Python that loads it and acts. obs [B, F] float32 becomes logits [B, 27], or mean [B, 3] where\n"
      "actions are continuous. A TorchScript module is code and is opened only with --trust.\n"
      "Examples:\n"
      "  gigastep export runs/first --team 0 --format safetensors --out pursuer\n"
      "  gigastep export runs/first/checkpoints/best.h5 --team 1 --format onnx --out evader");
  command->callback([options, &dispatch] { dispatch.run = [options] { export_policy(*options); }; });
}

}  // namespace giga
