#include "sweep/spec.hpp"

#include <algorithm>
#include <set>
#include <utility>

#include "config/settings.hpp"
#include "core/error.hpp"

namespace giga {
namespace {

Position place_of_key(const KeyPositions& given, const std::string& path, const std::filesystem::path& file) {
  const auto found = given.find(path);
  if (found != given.end()) return found->second;
  return {std::make_shared<const std::string>(file.string()), 0, 0};
}

template <class T>
bool is_empty_range(const std::optional<std::array<T, 2>>& range) {
  return range && !((*range)[0] < (*range)[1]);
}

/// Points of a grid; a number that is beyond all integers may be rounded.
double grid_points(const SweepSpec& spec) {
  double n = 1;
  for (const auto& [key, p] : spec.parameters)
    n *= p.integers ? static_cast<double>((*p.integers)[1] - (*p.integers)[0]) + 1
                    : static_cast<double>(p.choices.size());
  return n;
}

/// What is wrong with a parameter; empty where nothing is.
std::string fault_of(const ParameterSpec& p, SweepMethod method) {
  const int kinds = (p.choices.empty() ? 0 : 1) + (p.uniform ? 1 : 0) + (p.log_uniform ? 1 : 0) + (p.integers ? 1 : 0);
  if (kinds != 1) return "needs exactly one of choices (not empty), uniform, log_uniform, integers";
  const auto told = [](const auto& range) {
    return cat("the range ", (*range)[0], " to ", (*range)[1],
               " is empty: its first number must be less than its second");
  };
  if (is_empty_range(p.uniform)) return told(p.uniform);
  if (is_empty_range(p.log_uniform)) return told(p.log_uniform);
  if (is_empty_range(p.integers)) return told(p.integers);
  constexpr uint64_t kWidest = uint64_t{1} << 53;  // each of so many is drawn by a double
  if (p.integers && static_cast<uint64_t>((*p.integers)[1]) - static_cast<uint64_t>((*p.integers)[0]) >= kWidest)
    return cat("the range is too wide: at most ", kWidest, " integers");
  if (method == SweepMethod::grid && (p.uniform || p.log_uniform))
    return "a grid needs choices or integers; random and sobol draw from ranges";
  std::set<std::string> texts;
  for (const Choice& choice : p.choices)
    if (!texts.insert(choice.yaml).second) return cat("the choice ", choice.yaml, " is there twice");
  return "";
}

}  // namespace

bool FieldCodec<Choice>::read(const Node& node, Choice& value, const Allowed& allowed, const ReadSite& site) {
  if (node.is_null()) return site.fail(node, expected(allowed));
  value.yaml = print_node(node);
  return true;
}

bool FieldCodec<RunsAtOnce>::read(const Node& node, RunsAtOnce& value, const Allowed& allowed, const ReadSite& site) {
  if (!node.is_scalar() || node.text != "auto")
    return FieldCodec<int>::read(node, value.number, allowed, {site.path, site.errors, " or auto"});
  value.number = 0;
  return true;
}

/// Keys of the config that each run of a sweep gets from it, and what they come from.
constexpr std::pair<const char*, const char*> kSetBySweep[] = {
    {"seed", "seeds"}, {"train.stop_at_agent_steps", "halving"}, {"train.max_wall_time", "max_wall_time"}};

/// Refuses parameters that hold what is given elsewhere: one of both would be lost without a word. A parameter may be a
/// single key of `set`, whose value it changes then.
void check_overlaps(const SweepSpec& spec, const KeyPositions& given, const std::filesystem::path& file,
                    Errors& errors) {
  for (auto p = spec.parameters.begin(); p != spec.parameters.end(); ++p) {
    const std::string& key = p->first;
    const auto refuse = [&](const std::string& why) {
      errors.add(place_of_key(given, cat("parameters.", key), file), cat("parameters.", key, ": ", why));
    };
    const auto in_group = [&](const std::string& own) {
      return key == own ? std::string() : cat("a group is set as a whole, and ", own, " is in it: ");
    };
    for (const auto& [own, by] : kSetBySweep)
      if (paths_overlap(key, own)) refuse(cat(in_group(own), "the sweep sets this itself, by ", by));
    if (const std::string total = "train.total_agent_steps";
        spec.halving.first_agent_steps && paths_overlap(key, total))
      refuse(cat(in_group(total), "with halving all trials have the same stops; set says how long they are"));
    for (const std::string& assignment : spec.set)
      if (assignment.starts_with(key + "."))
        refuse(cat("a group is set as a whole, and ", assignment.substr(0, assignment.find('=')),
                   " of set is in it; name the keys of the group that differ"));
    for (auto other = std::next(p); other != spec.parameters.end(); ++other)
      if (paths_overlap(key, other->first))
        refuse(cat("a group is set as a whole, and the parameter ", other->first, " is in it"));
  }
}

int n_trials(const SweepSpec& spec) {
  if (spec.method != SweepMethod::grid) return spec.trials.value_or(kUsualTrials);
  return static_cast<int>(std::min(grid_points(spec), static_cast<double>(spec.trials.value_or(kMostTrials))));
}

SweepSpec read_sweep(const std::filesystem::path& file, KeyPositions& given) {
  SweepSpec spec;
  Errors errors;
  read_config_file(file, {}, spec, errors, &given);
  errors.throw_if_any();
  for (const auto& [key, parameter] : spec.parameters)
    if (const std::string fault = fault_of(parameter, spec.method); !fault.empty())
      errors.add(place_of_key(given, "parameters." + key, file), cat("parameters.", key, ": ", fault));
  check_overlaps(spec, given, file, errors);
  for (const auto& [key, by] : kSetBySweep)
    for (const std::string& assignment : spec.set)
      if (assignment.starts_with(cat(key, "=")))
        errors.add(place_of_key(given, "set", file), cat("set: ", key, ": the sweep sets this itself, by ", by));
  if (spec.method == SweepMethod::grid && !spec.trials && grid_points(spec) > kMostTrials)
    errors.add(place_of_key(given, "parameters", file),
               cat("parameters: a grid of ", grid_points(spec), " points; trials says how many of them are tried"));
  const auto needed = [&](const char* key, bool is_there, const char* what) {
    if (!is_there) errors.add(place_of_key(given, key, file), cat(key, ": ", what));
  };
  needed("config", !spec.config.empty(), "the sweep needs a run config");
  needed("parameters", !spec.parameters.empty(), "the sweep needs something to try");
  needed("metric", !spec.metric.empty(), "the sweep needs a column of metrics.csv to compare trials by");
  if (std::set<uint64_t>(spec.seeds.begin(), spec.seeds.end()).size() < spec.seeds.size())
    errors.add(place_of_key(given, "seeds", file), "seeds: one of them is there twice");
  errors.throw_if_any();
  return spec;
}

void check_halving(const HalvingSpec& halving, int64_t total, const KeyPositions& given) {
  if (!halving.first_agent_steps || *halving.first_agent_steps < total) return;
  const std::string key = "halving.first_agent_steps";
  throw InputError(cat(place_of_key(given, key, "halving").text(), ": ", key, ": ", *halving.first_agent_steps,
                       " is not before the end of the run, which has ", total,
                       " agent-steps (train.total_agent_steps); allowed: less than that"));
}

std::vector<int64_t> rungs_of(const HalvingSpec& halving, int64_t total) {
  std::vector<int64_t> rungs;
  if (halving.first_agent_steps)
    for (int64_t steps = *halving.first_agent_steps; steps < total; steps *= halving.factor) {
      rungs.push_back(steps);
      if (steps > total / halving.factor) break;  // the product may be beyond all integers
    }
  rungs.push_back(total);
  return rungs;
}

}  // namespace giga
