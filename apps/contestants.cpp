// Finding and loading contestants.
#include "apps/contestants.hpp"

#include <algorithm>
#include <iostream>
#include <sstream>
#include <system_error>

#include "config/fields.hpp"
#include "core/error.hpp"
#include "io/run_folder.hpp"
#include "scenario/compile.hpp"
#include "scenario/data_dirs.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

std::vector<std::string> script_names(const std::string& scripted) {
  if (scripted == "all") return FieldCodec<Scripted>::names();
  std::vector<std::string> names;
  if (scripted == "none") return names;
  std::istringstream list(scripted);
  for (std::string name; std::getline(list, name, ',');) {
    parse_scripted(name);
    if (std::find(names.begin(), names.end(), name) != names.end())
      throw InputError(cat("--scripted ", scripted, ": '", name, "' is there twice"));
    names.push_back(name);
  }
  if (names.empty()) throw InputError("--scripted: no name is given; allowed: all, none, or names");
  return names;
}

/// A checkpoint that takes part.
struct Candidate {
  fs::path file;
  std::string run;
  Checkpoint checkpoint;
  bool best = false;
};

/// The whole checkpoints among some files.
std::vector<Candidate> read_whole(const std::vector<fs::path>& files, const std::string& run) {
  std::vector<Candidate> whole;
  for (const fs::path& file : files) {
    try {
      whole.push_back({file, run, read_checkpoint(file), false});
    } catch (const InputError& e) {
      std::cerr << "warning: " << e.what() << "; it is left out\n";
    }
  }
  return whole;
}

std::string folder_name(const fs::path& folder) {
  fs::path whole = fs::absolute(folder).lexically_normal();
  if (!whole.has_filename()) whole = whole.parent_path();  // "runs/x/"
  return whole.filename().string();
}

/// The kept checkpoints of a run in order; the best one is one of them or beside them.
std::vector<Candidate> candidates_of_run(const fs::path& folder, int most) {
  const std::string run = folder_name(folder);
  const std::vector<fs::path> files = list_checkpoints(folder);
  std::vector<fs::path> chosen;
  for (const size_t k : spread(files.size(), static_cast<size_t>(most))) chosen.push_back(files[k]);
  std::vector<Candidate> all = read_whole(chosen, run);
  const fs::path best_file = folder / "checkpoints/best.h5";
  std::error_code code;
  if (fs::exists(best_file, code)) {
    for (Candidate& best : read_whole({best_file}, run)) {
      const int64_t updates = best.checkpoint.updates;
      auto at = std::find_if(all.begin(), all.end(), [&](const auto& c) { return c.checkpoint.updates >= updates; });
      if (at == all.end() || at->checkpoint.updates != updates) at = all.insert(at, std::move(best));
      at->best = true;
    }
  }
  if (all.empty())
    throw InputError(
        cat("the folder ", folder.string(), " holds no whole checkpoint (checkpoints/update_NNNNNNNN.h5)"));
  return all;
}

std::vector<Candidate> find_candidates(const ContestantRequest& request) {
  std::vector<Candidate> all;
  for (size_t k = 0; k < request.runs.size(); ++k) {
    const fs::path path = request.runs[k];
    std::error_code code;
    for (size_t j = 0; j < k; ++j)
      if (fs::equivalent(path, request.runs[j], code))
        throw InputError(cat("the run ", path.string(), " is given twice"));
    if (!fs::exists(path, code)) throw InputError(cat("there is no checkpoint or run folder ", path.string()));
    std::vector<Candidate> own;
    if (fs::is_directory(path, code)) {
      own = candidates_of_run(path, request.checkpoints);
    } else {
      const fs::path folder = fs::absolute(path).lexically_normal().parent_path().parent_path();
      own.push_back({path, folder_name(folder), read_checkpoint(path), false});
    }
    for (Candidate& candidate : own) all.push_back(std::move(candidate));
  }
  return all;
}

/// What is played: what was asked for, or the scenario of all candidates.
void choose_scenario(const ContestantRequest& request, const std::vector<Candidate>& candidates, Contestants& result) {
  const Candidate& first = candidates.front();
  if (!request.scenario.empty()) {
    result.scenario = load_scenario(request.scenario, data_dirs());
    result.spec = compile(result.scenario);
    return;
  }
  for (const Candidate& c : candidates)
    if (c.checkpoint.scenario_yaml != first.checkpoint.scenario_yaml)
      throw InputError(cat(first.file.string(), " and ", c.file.string(), " are of different scenarios (",
                           first.checkpoint.scenario_name, ", ", c.checkpoint.scenario_name,
                           ", or with different keys): say with --scenario which one is played"));
  result.scenario = result.policies.front().run.scenario;
  result.scenario.name = first.checkpoint.scenario_name;
  result.spec = result.policies.front().run.spec;
}

void check_fits(const Candidate& candidate, const SimSpec& own, const Contestants& result) {
  const int had = own.observation_size(), has = result.spec.observation_size();
  if (had != has || own.params.actions != result.spec.params.actions)
    throw InputError(cat(candidate.file.string(), " does not fit the scenario ", result.scenario.name, ": its policy ",
                         had != has ? cat("observes ", had, " numbers, here are ", has) : "has other actions"));
}

/// "RUN@UPDATES"; with "#2" behind where two runs of the same name are rated.
std::string unique_name(const std::string& wanted, const std::vector<Entrant>& others) {
  std::string name = wanted;
  for (int number = 2; std::any_of(others.begin(), others.end(), [&](const auto& e) { return e.name == name; });
       ++number)
    name = cat(wanted, "#", number);
  return name;
}

void add_scripts(const std::vector<std::string>& names, Contestants& result) {
  for (const std::string& name : names) {
    const Player player{nullptr, parse_scripted(name), false};
    result.entrants.push_back({name, {player, player}, {true, true}});
    result.infos.emplace_back();
  }
}

void add_checkpoint(const Candidate& candidate, const LoadedPolicies& loaded, bool greedy, Contestants& result) {
  const Checkpoint& c = candidate.checkpoint;
  Entrant entrant;
  entrant.name = unique_name(cat(candidate.run, "@", c.updates), result.entrants);
  for (int team = 0; team < kNTeams; ++team) {
    entrant.side[team] = {loaded.actor[team].get(), Scripted::random, greedy};
    entrant.plays[team] = loaded.actor[team] != nullptr;
  }
  result.entrants.push_back(std::move(entrant));
  result.infos.push_back(
      {false, candidate.run, c.updates, static_cast<double>(c.agent_steps), c.cursor.seconds, candidate.best});
}

}  // namespace

std::vector<size_t> spread(size_t n, size_t count) {
  if (count == 0 || count > n) count = n;
  std::vector<size_t> indices;
  for (size_t k = 1; k <= count; ++k) indices.push_back((k * n + count - 1) / count - 1);
  return indices;
}

Contestants find_contestants(const ContestantRequest& request, Device device) {
  const std::vector<std::string> scripts =
      script_names(request.scripted);  // wrong names are told before files are read
  const std::vector<Candidate> candidates = find_candidates(request);
  Contestants result;
  for (const Candidate& c : candidates)
    result.policies.push_back(
        load_policies(c.checkpoint.config_yaml, c.checkpoint.scenario_yaml, c.checkpoint.arrays, device));
  choose_scenario(request, candidates, result);
  result.n_threads = result.policies.front().run.config.train.n_threads;
  add_scripts(scripts, result);
  for (size_t k = 0; k < candidates.size(); ++k) {
    check_fits(candidates[k], result.policies[k].run.spec, result);
    add_checkpoint(candidates[k], result.policies[k], request.greedy, result);
  }
  return result;
}

}  // namespace giga
