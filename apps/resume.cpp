// gigastep resume: goes on with a run from its newest checkpoint, exactly.
#include <CLI/CLI.hpp>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/follow.hpp"
#include "apps/idle_settings.hpp"
#include "apps/joined_ranks.hpp"
#include "apps/metrics_files.hpp"
#include "apps/plan.hpp"
#include "apps/program_info.hpp"
#include "apps/run_replays.hpp"
#include "apps/start_ranks.hpp"
#include "apps/training.hpp"
#include "config/names.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/files.hpp"
#include "io/logger.hpp"
#include "io/run_folder.hpp"
#include "io/state_hash.hpp"
#include "io/tensorboard.hpp"
#include "learn/resume_config.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

struct ResumeOptions {
  std::string run;
  std::vector<std::string> overrides;
  bool quiet = false, no_color = false;
  RankOptions ranks;
};

/// The run folder that a path belongs to: itself, or that of the checkpoint file.
std::string folder_of(const std::string& path) {
  std::error_code code;
  if (!fs::exists(path, code)) fail_no_such_run(path);
  if (fs::is_directory(path, code)) return path;
  const fs::path beside = fs::absolute(path, code).parent_path(), folder = beside.parent_path();
  if (is_run_folder(beside) && fs::is_directory(beside / "checkpoints", code))
    throw InputError(cat(path, " is a file of a run; to go on with it: ", program_command(), " resume ",
                         shell_word(fs::path(path).has_parent_path() ? fs::path(path).parent_path().string() : ".")));
  if (fs::path(path).extension() != ".h5")
    throw InputError(cat(path, " is neither the folder of a run nor a checkpoint"));
  if (!is_run_folder(folder))
    throw InputError(cat(path, " does not lie in the checkpoints of a run folder: copy the whole folder"));
  return folder.string();
}

/// A run that was ended before its first checkpoint has nothing to go on from, and nothing to lose.
void refuse_barely_begun(const fs::path& folder) {
  if (lock_owner(folder) || !is_barely_begun(folder)) return;
  std::error_code code;
  const fs::path config = folder / "config.yaml";
  throw InputError(cat("the folder ", folder.string(),
                       " holds no checkpoint: its run was ended before the first one, and nothing is lost; to begin it "
                       "anew: ",
                       program_command(), " train ", fs::exists(config, code) ? shell_word(config.string()) : "CONFIG",
                       " --run-dir ", shell_word(folder.string())));
}

/// A checkpoint file that was named must be the newest: going on from an older one would leave newer ones behind.
void expect_newest(const fs::path& file, const RunFolder& folder) {
  std::error_code code;
  const fs::path newest = newest_checkpoint(folder.path());
  if (fs::equivalent(newest, file, code)) return;
  throw InputError(cat(file.string(), " is not the newest checkpoint of its run, ", newest.string(),
                       " is; to go on from an older one, take the newer ones out of the folder"));
}

/// Damaged checkpoints would be taken for the newest ones.
void set_aside(const std::vector<fs::path>& damaged) {
  for (const fs::path& file : damaged) {
    std::error_code code;
    fs::rename(file, file.string() + ".damaged", code);
    if (code) throw Error(cat("cannot rename ", file.string(), ": ", code.message()));
  }
}

/// Where best.h5 is damaged or gone the best evaluation from here on counts: else none would be kept until one is
/// better than what nobody has any more.
void forget_lost_best(const RunFolder& folder, RunCursor& cursor) {
  if (cursor.best_updates == 0) return;
  const fs::path best = folder.best_file();
  std::string why = cat(best.string(), ": is gone");
  std::error_code code;
  if (fs::exists(best, code)) {
    try {
      read_checkpoint(best);
      return;
    } catch (const InputError& e) {
      why = e.what();
    }
    set_aside({best});
  }
  std::cerr << "warning: " << why << "; the best evaluation from here on is kept\n";
  cursor.best_score = -1;
  cursor.best_updates = 0;
}

Json resume_info(const ResumedRun& resumed, Device device, const FoundCheckpoint& found) {
  Json info = run_info(resumed.run, device);
  info["checkpoint"] = found.file.filename().string();
  info["updates"] = found.checkpoint.updates;
  info["changes"] = resumed.changes;
  return info;
}

/// What the folder has lost and its checkpoint knows is written again: the report at the end reads it. Of run.json that
/// is not the machine, the time and the command line of the start.
void write_missing(const RunFolder& folder, const FoundCheckpoint& found, const RunConfig& resumed, bool quiet) {
  const Checkpoint& from = found.checkpoint;
  const RunConfig config = for_run_folder(resumed);
  const std::string source = found.file.filename().string();
  const Json info{{"scenario", from.scenario_name},
                  {"algorithm", config.train.algorithm},
                  {"seed", from.seed},
                  {"versions", {{"gigastep", from.gigastep_version}}},
                  {"restored_from", source}};
  const std::vector<std::string> written = folder.describe_missing(print_yaml(config, true), from.scenario_yaml, info,
                                                                   is_path(config.scenario) ? config.scenario : "");
  if (written.empty()) return;
  Logger(folder.log_file(), quiet ? Logger::Console::quiet : Logger::Console::all)
      .info(cat("missing in ", folder.path().string(), " and written again from ", source, ": ", join(written)));
}

/// metrics.csv and the TensorBoard events are begun anew where they are missing, and the checkpoint says so from here
/// on: else the next `resume` would find them too short.
void begin_lost_files(const RunFolder& folder, FoundCheckpoint& found) {
  const auto is_lost = [&](const fs::path& file) {
    std::error_code code;
    if (fs::exists(file, code)) return false;
    std::cerr << "warning: " << file.string() << " is missing and begun anew: what it held up to update "
              << found.checkpoint.updates << " is gone\n";
    return true;
  };
  RunCursor& cursor = found.checkpoint.cursor;
  const bool no_metrics = is_lost(folder.metrics_file()), no_events = is_lost(folder.events_file());
  if (!no_metrics && !no_events) return;
  if (no_metrics) cursor.metrics_bytes = MetricsCsv(folder.metrics_file()).size();
  if (no_events) {
    const auto wall_time = static_cast<double>(std::time(nullptr));
    cursor.events_bytes = TensorBoardEvents::create(folder.events_file(), wall_time).size();
  }
  write_checkpoint(found.file, found.checkpoint);
}

/// The keys and values of a resolved config as a run folder has it.
std::vector<FieldInfo> values_of(RunConfig config) {
  config = for_run_folder(std::move(config));
  return list_fields(fields_of(config));
}

/// The same of a text. Throws InputError where it is none.
std::vector<FieldInfo> values_in(const std::string& yaml) {
  Errors errors;
  const Document document = parse_yaml_text(yaml, "config.yaml");
  RunConfig config;
  read_fields(document.root, config, errors);
  errors.throw_if_any();
  return values_of(std::move(config));
}

/// Somebody may have edited config.yaml in the belief that the run goes on with it.
void warn_of_edits(const RunFolder& folder, const Checkpoint& from, const RunConfig& resumed) {
  const fs::path file = folder.config_file();
  std::error_code code;
  if (!fs::exists(file, code)) return;
  std::vector<std::string> edited;
  try {
    const std::vector<FieldInfo> there = values_in(read_file(file)), saved = values_in(from.config_yaml),
                                 goes_on = values_of(resumed);
    for (size_t k = 0; k < there.size(); ++k) {
      const std::string& value = there[k].default_value;
      if (value != saved[k].default_value && value != goes_on[k].default_value) edited.push_back(there[k].path);
    }
    if (edited.empty()) return;
  } catch (const InputError&) {  // it is no config any more
  }
  std::cerr << "warning: " << file.string() << " differs from what the checkpoint holds"
            << (edited.empty() ? "" : cat(" (", join(edited), ")"))
            << ": the run goes on with what its checkpoint holds; resume --set key=value changes settings\n";
}

void warn(const FoundCheckpoint& found) {
  for (const std::string& line : found.damaged)
    std::cerr << "warning: " << line << "; going on from " << found.file.string() << '\n';
  if (found.checkpoint.gigastep_version != program_version())
    std::cerr << "warning: the checkpoint was written by gigastep " << found.checkpoint.gigastep_version << ", this is "
              << program_version() << ": the run goes on, but perhaps not bit for bit\n";
}

int resume(const ResumeOptions& o, Dispatch& dispatch) {
  const JoinedRanks joined = join_others(o.ranks, dispatch);
  const bool starts_ranks = o.ranks.to_start() > 1;
  // Rank 0 holds the folder; others read the checkpoint only.
  const fs::path path = folder_of(o.run);
  std::unique_ptr<const RunFolder> folder;
  if (joined.leads()) {
    refuse_barely_begun(path);
    folder.reset(new RunFolder(RunFolder::open(path.string())));
  }
  FoundCheckpoint found = find_checkpoint(o.run);
  std::error_code code;
  if (folder && !fs::is_directory(o.run, code)) expect_newest(o.run, *folder);
  const Checkpoint& from = found.checkpoint;
  if (folder && !starts_ranks) warn(found);

  const ResumedRun resumed = resume_config(from.config_yaml, from.scenario_yaml, o.overrides);
  if (folder && !starts_ranks) {
    warn_of_edits(*folder, from, resumed.run.config);
    warn_of_idle(o.overrides, resumed.run);
  }
  TrainingSetup setup{resumed.run, device_of_rank(resumed.run.config.device, joined), nullptr, &from, o.quiet,
                      !o.no_color};
  setup.ranks = joined.ranks;
  setup.settings_changed = !resumed.changes.empty();
  if (from.agent_steps >= resumed.run.config.train.total_agent_steps) {
    // Fewer than are done, of a run that was to go on: neither what is wanted nor the end of the run.
    const std::vector<FieldInfo> saved = values_in(from.config_yaml);
    for (const FieldInfo& field : saved)
      if (field.path == "train.total_agent_steps" &&
          static_cast<double>(from.agent_steps) < std::stod(field.default_value))
        throw InputError(cat("--set train.total_agent_steps: ", resumed.run.config.train.total_agent_steps,
                             " is not more than the ", from.agent_steps, " agent-steps that the run has done of ",
                             field.default_value));
    // A sweep may set where a run stops that has just come to its end.
    if (folder && !resumed.changes.empty())
      std::cerr << "warning: --set " << join(o.overrides, " --set ") << " changes nothing: the run is complete\n";
    if (folder) write_missing(*folder, found, resumed.run.config, o.quiet);
    if (folder)
      std::cout << "the run " << path.string() << " is complete: " << from.updates << " updates, " << from.agent_steps
                << " agent-steps; to go on: --set train.total_agent_steps=N, more than these\n";
    if (folder && !fs::exists(folder->report_file(), code))
      std::cout << "its report is missing; to write it: " << program_command() << " report "
                << shell_word(path.string()) << '\n';
    if (folder && !fs::exists(folder->replays_page(), code)) write_replays_page(*folder, from.updates);
    return finish(joined, 0);
  }
  if (const Opponent& opponent = resumed.run.config.train.opponent;
      opponent.is_path() && !fs::exists(opponent.name, code))
    throw InputError(cat("the opponent of the run is not at ", opponent.name,
                         " any more; where it lies now, the same one: --set train.opponent=PATH"));
  expect_devices(o.ranks, resumed.run.config.device, setup.device);
  if (starts_ranks) {
    algorithm_of(setup.run.config).expect_divides(setup.run.config, o.ranks.to_start());
    folder.reset();
    return start_ranks(o.ranks.to_start());
  }
  dispatch.size_key = algorithm_of(setup.run.config).size(setup.run.config).key;
  expect_same(joined.ranks.get(), "program, config or checkpoint",
              cat(described(setup.run), "update ", from.updates, "\nstate ", state_sha256(from.arrays), '\n'));
  check_memory(setup.run, setup.device, joined.size());
  setup.learner = make_learner(setup.run, setup.device, joined.ranks.get());
  setup.learner->load(from.arrays);
  if (!folder) return finish(joined, follow(std::move(setup)));

  MetricsFiles::expect(*folder, from.cursor);
  set_aside(found.damaged_files);
  forget_lost_best(*folder, found.checkpoint.cursor);
  begin_lost_files(*folder, found);
  write_missing(*folder, found, resumed.run.config, o.quiet);
  folder->describe_resume(print_yaml(for_run_folder(resumed.run.config), true),
                          resume_info(resumed, setup.device, found));
  dispatch.advice = [path = folder->path()] { return advice_to_resume(path); };
  return finish(joined, train_in(*folder, std::move(setup)));
}

}  // namespace

void add_resume_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("resume", "go on with a run that was stopped, exactly where it was");
  auto options = std::make_shared<ResumeOptions>();
  command->add_option("RUN", options->run, "run folder, or its newest checkpoint file")->required()->type_name("");
  add_set_option(*command, options->overrides);
  add_display_options(*command, options->quiet, options->no_color);
  add_rank_options(*command, options->ranks);
  options->ranks.device_option = "--set device=cpu";
  command->footer(
      "On the same machine, build and device a run that was stopped and resumed is the same, bit for bit, as one that\n"
      "was not: gigastep inspect shows the same SHA-256. Rows of metrics.csv and TensorBoard events that were written\n"
      "after the checkpoint are cut off. Of a run folder the newest whole checkpoint is taken; damaged ones are named\n"
      "and set aside, and config.yaml, scenario.yaml and run.json written again from it where they are missing.\n"
      "A checkpoint file that is named is taken as it is, or refused.\n"
      "Settings that may change (--set; a name that ends in a point stands for all keys of its group):\n" +
      resumable_settings() +
      "Examples:\n"
      "  gigastep resume runs/first\n"
      "  gigastep resume runs/first --set train.total_agent_steps=2e9");
  command->callback([options, &dispatch] {
    dispatch.run = [options, &dispatch] { dispatch.exit_code = resume(*options, dispatch); };
  });
}

}  // namespace giga
