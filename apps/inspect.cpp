// gigastep inspect: what a checkpoint holds, and one hash over all that was learned.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "io/number.hpp"
#include "io/run_folder.hpp"
#include "io/state_hash.hpp"

namespace giga {
namespace {

struct InspectOptions {
  std::string checkpoint, json;
};

const char* type_name(ArrayType type) {
  constexpr const char* kNames[] = {"f32", "f64", "i32", "i64", "u8"};
  return kNames[static_cast<size_t>(type)];
}

Json to_json(const FoundCheckpoint& found) {
  const Checkpoint& c = found.checkpoint;
  Json arrays = Json::array();
  for (const NamedArray& a : c.arrays)
    arrays.push_back({{"name", a.name}, {"type", type_name(a.type)}, {"shape", a.shape}, {"bytes", a.bytes.size()}});
  return {{"file", found.file.string()},
          {"format_version", c.format_version},
          {"gigastep_version", c.gigastep_version},
          {"scenario", c.scenario_name},
          {"seed", c.seed},
          {"updates", c.updates},
          {"agent_steps", c.agent_steps},
          {"seconds", c.cursor.seconds},
          {"best_score", c.cursor.best_score < 0 ? Json() : Json(c.cursor.best_score)},
          {"best_updates", c.cursor.best_updates},
          {"sha256", state_sha256(c.arrays)},
          {"arrays", std::move(arrays)}};
}

void print(const FoundCheckpoint& found) {
  const Checkpoint& c = found.checkpoint;
  std::cout << found.file.string() << "\nformat " << c.format_version << ", written by gigastep " << c.gigastep_version
            << "\nscenario " << c.scenario_name << ", seed " << c.seed << "\n"
            << c.updates << " updates, " << c.agent_steps << " agent-steps, " << print_duration(c.cursor.seconds)
            << " of training\n";
  if (c.cursor.best_score >= 0)
    std::cout << "best evaluation so far after update " << c.cursor.best_updates << ": weaker team wins "
              << print_share(c.cursor.best_score) << '\n';
  std::cout << '\n';
  size_t bytes = 0;
  for (const NamedArray& a : c.arrays) {
    char line[160];
    std::snprintf(line, sizeof line, "  %-48s %-4s %-20s\n", a.name.c_str(), type_name(a.type),
                  shape_text(a.shape).c_str());
    std::cout << line;
    bytes += a.bytes.size();
  }
  std::cout << '\n'
            << c.arrays.size() << " arrays, " << print_short(static_cast<double>(bytes)) << "B\nsha256 "
            << state_sha256(c.arrays) << '\n';
}

void inspect(const InspectOptions& o) {
  const FoundCheckpoint found = find_checkpoint(o.checkpoint);
  for (const std::string& line : found.damaged) std::cerr << "warning: " << line << '\n';
  if (!o.json.empty()) write_json(to_json(found), o.json);
  if (o.json != "-") print(found);
}

}  // namespace

void add_inspect_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("inspect", "show what a checkpoint holds, and a hash of its state");
  auto options = std::make_shared<InspectOptions>();
  command->add_option("CHECKPOINT", options->checkpoint, "checkpoint file, or run folder (its newest whole checkpoint)")
      ->required()
      ->type_name("");
  add_json_option(*command, options->json);
  command->footer(
      "The SHA-256 is over all learned state, that is over every array that is listed (name, type, shape, bytes): two\n"
      "runs of which it is the same are the same. Seconds and file positions are not part of it.\n"
      "Examples:\n"
      "  gigastep inspect runs/first\n"
      "  gigastep inspect runs/first/checkpoints/best.h5 --json -");
  command->callback([options, &dispatch] {
    dispatch.uses_threads = false;
    dispatch.run = [options] { inspect(*options); };
  });
}

}  // namespace giga
