// gigastep bench: agent-steps per second of simulation, closed loop, training and evolution.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/benchmark.hpp"
#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/joined_ranks.hpp"
#include "apps/option_value.hpp"
#include "apps/program_info.hpp"
#include "apps/start_ranks.hpp"
#include "config/fields.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "io/number.hpp"

namespace giga {
namespace {

constexpr int kCpuWorlds = 1024, kGpuWorlds = 65536;

using Measure = BenchResult (*)(const BenchOptions&, Device, int);

/// The seconds of a part of an update, and the rate if an update were that part alone.
Json part_json(const BenchResult& r, double seconds) {
  return {{"seconds_per_update", seconds / static_cast<double>(r.steps) / static_cast<double>(r.rates.size())},
          {"agent_steps_per_second", r.work.agent_steps / seconds}};
}

std::string part_text(const BenchResult& r, double seconds) {
  char text[80];
  std::snprintf(text, sizeof text, "%.4g s an update, %s agent-steps/s",
                seconds / static_cast<double>(r.steps) / static_cast<double>(r.rates.size()),
                print_short(r.work.agent_steps / seconds).c_str());
  return text;
}

/// What an earlier call measured with as many worlds.
struct Earlier {
  std::string commit;
  double median, low, high;  ///< agent-steps per second; quartiles
};

/// Of the results in a file; refused where they are of something else.
class Comparison {
 public:
  Comparison(const std::string& path, const std::string& kind, Device device) : path_(path) {
    if (path.empty()) return;
    std::ifstream file(path);
    if (!file) throw InputError("--compare: cannot read " + path);
    json_ = Json::parse(file, nullptr, false);
    if (!json_.is_object() || !json_.contains("results") || !json_["results"].is_array() || !json_.contains("kind"))
      throw InputError("--compare: " + path + " was not written by gigastep bench " + kind + " --json");
    const auto has_result = [](const Json& r) {
      const auto is = [&r](const char* key, bool (Json::*is_type)() const) {
        return r.contains(key) && (r[key].*is_type)();
      };
      if (!r.is_object() || !is("worlds", &Json::is_number) || !is("agent_steps_per_second", &Json::is_number))
        return false;
      if (!r.contains("interquartile")) return true;  // older ones lack it
      const Json& quartiles = r["interquartile"];
      return quartiles.is_array() && quartiles.size() == 2 && quartiles[0].is_number() && quartiles[1].is_number();
    };
    if (!json_.contains("scenario") || !json_["scenario"].is_string() ||
        !std::all_of(json_["results"].begin(), json_["results"].end(), has_result))
      throw InputError("--compare: " + path + " lacks a scenario, or has results without worlds, rate or quartiles");
    if (json_["kind"] != kind)
      throw InputError(cat("--compare: ", path, " has results of bench ", json_["kind"].dump(), ", not of ", kind));
    const Json hardware = json_.value("hardware", Json::object());
    const std::string measured = hardware.is_object() ? hardware.value("device", "") : "";
    if (measured.starts_with("cuda") != device.is_cuda())
      throw InputError(cat("--compare: ", path, " was measured on ", measured, ", and this is ", device.name()));
  }
  /// What it has with so many worlds; says so where it has nothing, or something else.
  std::optional<Earlier> of(const BenchResult& r) const {
    if (path_.empty()) return std::nullopt;
    if (const std::string scenario = json_.value("scenario", ""); scenario != r.scenario)
      throw InputError(cat("--compare: ", path_, " has results of scenario ", scenario, ", not of ", r.scenario));
    for (const Json& old : json_["results"]) {
      if (old.value("worlds", 0) != r.worlds || !old.contains("interquartile")) continue;
      const std::string arithmetic = old.value("arithmetic", "");
      if (arithmetic != r.arithmetic)
        std::cerr << "note: " << path_ << " has " << r.worlds << " worlds in " << arithmetic << ", and this is "
                  << r.arithmetic << '\n';
      return Earlier{old.value("commit", "unknown"), old.value("agent_steps_per_second", 0.0),
                     old["interquartile"].at(0).get<double>(), old["interquartile"].at(1).get<double>()};
    }
    std::cerr << "note: " << path_ << " has no result of " << r.worlds << " worlds to compare with\n";
    return std::nullopt;
  }

 private:
  std::string path_;
  Json json_;
};

/// new / old, and what it may be by the quartiles of both.
struct Ratio {
  double median, low, high;
  Ratio(const BenchResult& now, const Earlier& then)
      : median(now.quantile(0.5) / then.median),
        low(now.quantile(0.25) / then.high),
        high(now.quantile(0.75) / then.low) {}
};

/// The rate of several ranks in units of so many times that of one alone; and what it may be by the quartiles of both.
Ratio weak_scaling(const BenchResult& r) {
  const BenchResult& one = *r.one_rank;
  return {r, {"", r.ranks * one.quantile(0.5), r.ranks * one.quantile(0.25), r.ranks * one.quantile(0.75)}};
}

Json result_json(const BenchResult& r, const std::optional<Earlier>& earlier) {
  Json checks = Json::object();
  for (const auto& [name, value] : r.checks) checks[name] = value;
  Json json{{"arithmetic", r.arithmetic},
            {"commit", program_commit()},
            {"worlds", r.worlds},
            {"steps", r.steps},
            {"repeats", r.rates.size()},
            {"agent_steps_per_second", r.quantile(0.5)},
            {"min", r.rates.front()},
            {"max", r.rates.back()},
            {"interquartile", {r.quantile(0.25), r.quantile(0.75)}},
            {"rates", r.rates},
            {"memory_bytes", r.memory_bytes},
            {"checksum", std::move(checks)}};
  if (r.work.learning_seconds > 0) {
    json["rollout"] = part_json(r, r.work.rollout_seconds);
    json["learning"] = part_json(r, r.work.learning_seconds);
  }
  if (r.one_rank) {
    const Ratio scaling = weak_scaling(r);
    json["ranks"] = r.ranks;
    json["one_rank"] = result_json(*r.one_rank, std::nullopt);
    json["weak_scaling"] = scaling.median;
    json["weak_scaling_by_quartiles"] = {scaling.low, scaling.high};
  }
  if (!r.closed_loop_arithmetic.empty()) json["closed_loop_arithmetic"] = r.closed_loop_arithmetic;
  if (!r.step_way.empty()) json["step"] = r.step_way;
  if (r.bytes > 0) json["bytes_per_agent_step"] = r.bytes;
  if (r.copy_rate > 0) {
    json["copy_rate_bytes_per_second"] = r.copy_rate;
    json["share_of_copy_rate"] = r.bytes * r.quantile(0.5) / r.copy_rate;
  }
  if (earlier) {
    const Ratio ratio(r, *earlier);
    json["compared"] = {{"commit", earlier->commit},
                        {"agent_steps_per_second", earlier->median},
                        {"ratio", ratio.median},
                        {"ratio_by_quartiles", {ratio.low, ratio.high}}};
  }
  return json;
}

std::string result_lines(const BenchResult& r, bool proof, const std::optional<Earlier>& earlier) {
  char line[200];
  std::snprintf(line, sizeof line, "%10d %10lld %10s %18s %12s %10s - %-10s %10s - %-10s %8s\n", r.worlds,
                static_cast<long long>(r.steps), r.arithmetic.c_str(), program_commit(),
                print_short(r.quantile(0.5)).c_str(), print_short(r.rates.front()).c_str(),
                print_short(r.rates.back()).c_str(), print_short(r.quantile(0.25)).c_str(),
                print_short(r.quantile(0.75)).c_str(), print_short(static_cast<double>(r.memory_bytes)).c_str());
  const std::string indent(11, ' ');
  std::string text = line;
  if (r.work.learning_seconds > 0)
    text += indent + "rollout " + part_text(r, r.work.rollout_seconds) + "; learning " +
            part_text(r, r.work.learning_seconds) + "\n";
  if (r.one_rank) {
    const Ratio scaling = weak_scaling(r);
    std::snprintf(line, sizeof line,
                  "%d ranks: %.1f %% of %d times one with %d worlds (%.1f to %.1f by the quartiles)\n", r.ranks,
                  100 * scaling.median, r.ranks, r.one_rank->worlds, 100 * scaling.low, 100 * scaling.high);
    text += indent + line;
  }
  if (!r.step_way.empty()) text += indent + "worlds step by " + r.step_way + "\n";
  if (r.bytes > 0) {
    std::snprintf(line, sizeof line, "at least %.0f bytes an agent-step", r.bytes);
    text += indent + line;
    if (r.copy_rate > 0) {
      std::snprintf(line, sizeof line, ": %.1f %% of %s bytes/s that a copy moves",
                    100 * r.bytes * r.quantile(0.5) / r.copy_rate, print_short(r.copy_rate).c_str());
      text += line;
    }
    text += "\n";
  }
  if (earlier) {
    const Ratio ratio(r, *earlier);
    std::snprintf(line, sizeof line, "%.3f times the %s of %s (%.3f to %.3f by the quartiles)\n", ratio.median,
                  print_short(earlier->median).c_str(), earlier->commit.c_str(), ratio.low, ratio.high);
    text += indent + line;
  }
  // Of these the shares are results; all else only proves the work, for who asks.
  std::string figures;
  for (const auto& [name, value] : r.checks) {
    const bool result = name == "generations_per_second" || name == "share_of_closed_loop";
    if (proof || result)
      figures += (figures.empty() ? "" : ", ") + name + " " + (result ? print_short(value) : print_number(value));
  }
  if (!r.closed_loop_arithmetic.empty()) figures += ", closed_loop_arithmetic " + r.closed_loop_arithmetic;
  return figures.empty() ? text : text + indent + figures + "\n";
}

int bench(const std::string& kind, Measure measure_one, BenchOptions o, Dispatch& dispatch) {
  for (const std::string& assignment : o.overrides)
    if (assignment.starts_with("device=")) throw InputError(cat("--set ", assignment, ": --device says where"));
  const JoinedRanks joined = kind == "train" || kind == "es" ? join_others(o.ranks, dispatch) : JoinedRanks();
  const Device device = device_of_rank(o.device, joined);
  expect_devices(o.ranks, o.device, device);
  if (o.ranks.to_start() > 1) return start_ranks(o.ranks.to_start());
  o.joined = joined.ranks.get();
  const Comparison comparison(o.compare, kind, device);
  std::vector<int> sizes = o.worlds;
  if (sizes.empty()) sizes = {kind == "train" || kind == "es" ? 0 : device.is_cuda() ? kGpuWorlds : kCpuWorlds};

  const bool for_people = o.json != "-" && joined.leads();
  Json results = Json::array();
  double best = 0;
  std::string scenario;
  for (const int worlds : sizes) {
    const BenchResult result = measure_one(o, device, worlds);
    if (!joined.leads()) continue;
    const std::optional<Earlier> earlier = comparison.of(result);
    results.push_back(result_json(result, earlier));
    best = std::max(best, result.quantile(0.5));
    scenario = result.scenario;
    if (!for_people) continue;
    // Only here, so that a refused input prints no head of a table.
    if (results.size() == 1)
      std::cout
          << kind << " on " << device.name() << ", agent-steps/s over " << counted(o.repeats, "repeats") << "\n"
          << "    worlds      steps arithmetic             commit       median         min - max            quartiles  "
             "         bytes\n";
    if (result.one_rank) std::cout << result_lines(*result.one_rank, o.proof, std::nullopt);
    std::cout << result_lines(result, o.proof, earlier) << std::flush;
  }
  if (o.json.empty() || !joined.leads()) return finish(joined, 0);
  write_json({{"kind", kind},
              {"scenario", scenario},
              {"agent_steps_per_second", best},
              {"results", std::move(results)},
              {"versions", version_info()},
              {"hardware", hardware_info(device)},
              {"command_line", command_line()}},
             o.json);
  return finish(joined, 0);
}

/// One of the benchmarks, with the options that all have.
CLI::App* add_kind(CLI::App& parent, Dispatch& dispatch, const std::shared_ptr<BenchOptions>& options,
                   const std::string& kind, const std::string& description, Measure measure_one) {
  CLI::App* command = parent.add_subcommand(kind, description);
  command->add_option("--scenario", options->scenario, "name or path of a scenario")
      ->check(some_name())
      ->capture_default_str()
      ->type_name("S");
  command->add_option("--worlds", options->worlds, "numbers of worlds, each measured by itself, as 1024,4096")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->transform(value_of<int>(range(1, kMostWorlds)))
      ->type_name("N,...");
  add_device_option(*command, options->device)->capture_default_str();
  command
      ->add_option("--steps", options->steps,
                   "steps (train: updates, es: generations) per repeat; 0: about half a second")
      ->transform(value_of<int64_t>(range(0, 1e9)))
      ->capture_default_str()
      ->type_name("N");
  command->add_option("--repeats", options->repeats, "measurements after the warm-up")
      ->transform(value_of<int>(range(1, 10'000)))
      ->capture_default_str()
      ->type_name("R");
  command->add_flag("--proof", options->proof,
                    "also print what proves the work: sums over what was computed, episodes that ended");
  add_json_option(*command, options->json);
  command
      ->add_option("--compare", options->compare,
                   "also print the ratio to the results in this file, which --json of an earlier call has written")
      ->type_name("FILE");
  command->callback([options, kind, measure_one, &dispatch] {
    dispatch.run = [options, kind, measure_one, &dispatch] {
      dispatch.exit_code = bench(kind, measure_one, *options, dispatch);
    };
  });
  return command;
}

void add_seed_option(CLI::App& command, uint64_t& seed) {
  command.add_option("--seed", seed, "seed of everything random")
      ->transform(value_of<uint64_t>(anything()))
      ->capture_default_str()
      ->type_name("N");
}

/// An option whose values are names of an enumeration, of those that `names` has.
template <class Enum>
void add_enum_option(CLI::App& command, const std::string& name, Enum& value, const std::string& help,
                     const std::vector<std::string>& names = FieldCodec<Enum>::names()) {
  command
      .add_option_function<std::string>(
          name,
          [&value](const std::string& text) {
            const std::vector<std::string> all = FieldCodec<Enum>::names();
            value = static_cast<Enum>(std::find(all.begin(), all.end(), text) - all.begin());
          },
          help)
      ->transform(value_of<std::string>(one_of(names)))
      ->default_str(FieldCodec<Enum>::print(value))
      ->type_name(join(names, "|"));
}

void add_precision_option(CLI::App& command, const std::string& name, Precision& precision) {
  std::vector<std::string> names = FieldCodec<Precision>::names();
  std::erase(names, "fp16");  // is for populations alone
  add_enum_option(command, name, precision, "arithmetic of the closed loop's networks on a GPU", names);
}

/// How worlds are stepped.
void add_step_options(CLI::App& command, BenchOptions& options) {
  add_enum_option(command, "--compile-step", options.compile_step,
                  "whether a GPU compiles the step for the scenario; as train.compile_step");
  add_enum_option(command, "--pairs", options.pairs, "how pairs of agents are found; as train.pairs");
}

/// A benchmark of a learner, which takes a config.
CLI::App* add_learner(CLI::App& parent, Dispatch& dispatch, const std::string& kind, const std::string& config,
                      const std::string& description, Measure measure_one) {
  auto options = std::make_shared<BenchOptions>();
  options->scenario.clear();
  options->config = config;
  CLI::App* command = add_kind(parent, dispatch, options, kind, description, measure_one);
  command->add_option("--config", options->config, "run config: file, or name of one that comes with gigastep")
      ->capture_default_str()
      ->type_name("CONFIG");
  add_set_option(*command, options->overrides);
  add_rank_options(*command, options->ranks);
  if (kind == "es") add_precision_option(*command, "--closed-loop-precision", options->precision);
  return command;
}

}  // namespace

void add_bench_command(CLI::App& app, Dispatch& dispatch) {
  CLI::App* command = app.add_subcommand("bench", "measure agent-steps per second");
  command->require_subcommand(1);
  command->footer(
      "Agent-steps per second are worlds x agents x steps / seconds: median, smallest, largest and quartiles over the\n"
      "repeats after a warm-up; episodes that end are reset. Memory (bytes) is what a GPU lost in free memory, on the\n"
      "CPU the resident set of the process. --proof prints what proves the work, as JSON does: observations are "
      "finite\n"
      "and written, episodes end and begin anew. Each row names the arithmetic of the networks' matrix products (CPUs "
      "compute in fp32), the\n"
      "commit of the program, and, where a learner is timed, what rollout and learning took on the device. sim says "
      "how\n"
      "many bytes an agent-step must at least move through memory, and on a GPU which share of the rate of a copy\n"
      "that is.\n"
      "Examples:\n"
      "  gigastep bench sim --scenario identical_2_vs_2 --worlds 1024,16384,65536\n"
      "  gigastep bench closed-loop --hidden 64,64 --json -\n"
      "  gigastep bench train --config mappo --device cuda --repeats 5");

  auto sim = std::make_shared<BenchOptions>();
  CLI::App* simulation =
      add_kind(*command, dispatch, sim, "sim", "simulation with random actions, every observation written", bench_sim);
  add_seed_option(*simulation, sim->seed);
  add_step_options(*simulation, *sim);
  simulation->add_flag("--nothing-stored", sim->nothing_stored,
                       "worlds alone: neither observations nor rewards are written");
  simulation->footer(
      "Of a scenario with images (_rgb) each agent-step writes one, all its bytes.\n"
      "Examples:\n"
      "  gigastep bench sim --scenario identical_5_vs_5 --worlds 65536 --device cuda --json result.json\n"
      "  gigastep bench sim --scenario identical_5_vs_5_rgb --worlds 16384 --device cuda");

  auto loop = std::make_shared<BenchOptions>();
  CLI::App* closed = add_kind(*command, dispatch, loop, "closed-loop", "simulation driven by two sampling policies",
                              bench_closed_loop);
  closed->add_option("--hidden", loop->hidden, "sizes of the hidden layers of the policies")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->transform(value_of<int>(range(1, 16384)))
      ->capture_default_str()
      ->type_name("N,...");
  add_precision_option(*closed, "--precision", loop->precision);
  add_seed_option(*closed, loop->seed);
  add_step_options(*closed, *loop);
  closed->footer("Example:\n  gigastep bench closed-loop --scenario identical_5_vs_5 --hidden 256,256");

  CLI::App* train =
      add_learner(*command, dispatch, "train", "mappo", "whole updates: rollout and learning", bench_train);
  train->footer(
      "Scenario, worlds and seed are those of the config unless given. With --gpus or --ranks rank 0 is measured\n"
      "alone first and then all, each with so many worlds: 100 % is as many times the rate of one.\n"
      "Examples:\n"
      "  gigastep bench train --config mappo --gpus 2\n"
      "  gigastep bench train --config mappo --set mappo.n_minibatches=4 --worlds 4096,16384 --device cuda");

  CLI::App* es = add_learner(*command, dispatch, "es", "openai_es",
                             "whole generations of an evolution strategy, and the closed loop beside it", bench_es);
  es->footer(
      "Only steps inside episodes count. --worlds: of both teams' populations, in whole pairs of members; without it "
      "as "
      "the\nconfig says.\n"
      "Example:\n  gigastep bench es --config snes --scenario identical_5_vs_5 --worlds 16384,65536 --device cuda");
}

}  // namespace giga
