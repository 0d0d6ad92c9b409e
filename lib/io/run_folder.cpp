// Making run folders, and finding the checkpoints in them.
#include "io/run_folder.hpp"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <system_error>
#include <vector>

#include "config/names.hpp"
#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "io/replay.hpp"
#include "io/tensorboard.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

constexpr const char* kCheckpoints = "checkpoints";
constexpr const char* kBest = "best.h5";
constexpr const char* kReplays = "replays";
constexpr const char* kScenario = "scenario.yaml";
constexpr const char* kMetrics = "metrics.csv";
constexpr const char* kLog = "log.txt";
/// What `train` makes before its first checkpoint, in this order.
constexpr const char* kBeginning[] = {kCheckpoints, kScenario, "run.json",      "config.yaml",
                                      kLog,         kMetrics,  kTensorBoardFile};
constexpr int kMostRuns = 100'000;

[[noreturn]] void fail_to_create(const fs::path& path, const std::error_code& code) {
  throw InputError(cat("cannot create the folder ", path.string(), ": ", code.message()));
}

/// Makes the folder itself; false where it exists.
bool make_folder(const fs::path& path) {
  std::error_code code;
  if (path.has_parent_path()) fs::create_directories(path.parent_path(), code);
  if (code) fail_to_create(path.parent_path(), code);
  const bool made = fs::create_directory(path, code);
  if (code) fail_to_create(path, code);
  return made;
}

std::string name_of_update(int64_t updates, const char* ending) {
  char name[64];
  std::snprintf(name, sizeof name, "update_%08lld%s", static_cast<long long>(updates), ending);
  return name;
}

/// Number in "update_00000100.h5"; -1 for other names.
int64_t updates_of(const fs::path& file, std::string_view ending = ".h5") {
  static constexpr std::string_view kPrefix = "update_";
  const std::string name = file.filename().string();
  if (name.size() <= kPrefix.size() + ending.size() || name.compare(0, kPrefix.size(), kPrefix) != 0 ||
      name.compare(name.size() - ending.size(), ending.size(), ending) != 0)
    return -1;
  const std::string digits = name.substr(kPrefix.size(), name.size() - kPrefix.size() - ending.size());
  const bool number = std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
  return number && digits.size() <= 18 ? std::stoll(digits) : -1;
}

/// The checkpoints in a folder, or the files of another ending, oldest first.
std::vector<fs::path> checkpoints_in(const fs::path& folder, std::string_view ending = ".h5") {
  std::vector<fs::path> files;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (updates_of(entry.path(), ending) >= 0) files.push_back(entry.path());
  std::sort(files.begin(), files.end(),
            [=](const fs::path& a, const fs::path& b) { return updates_of(a, ending) < updates_of(b, ending); });
  return files;
}

/// Whether a file is the scenario under another name, as describe() writes it.
bool is_scenario_copy(const fs::path& file) {
  std::error_code code;
  const fs::path scenario = file.parent_path() / kScenario;
  return file.filename() != kScenario && fs::is_regular_file(file, code) && fs::is_regular_file(scenario, code) &&
         fs::file_size(file, code) == fs::file_size(scenario, code) && read_file(file) == read_file(scenario);
}

/// Whether `train` may have made this before its first checkpoint.
bool is_of_beginning(const fs::path& path) {
  std::error_code code;
  const std::string name = path.filename().string();
  const fs::path checkpoints = path.parent_path() / kCheckpoints;
  if (fs::is_symlink(path, code)) return false;
  if (name == kCheckpoints) {
    const fs::directory_iterator files(path, code);
    return !code && std::all_of(begin(files), end(files), [](const auto& f) { return is_unfinished(f.path()); });
  }
  if (!fs::is_regular_file(path, code)) return false;
  if (name == kLockFile) return fs::file_size(path, code) == 0 || read_file(path).starts_with("process ");
  if (name == kMetrics) return fs::file_size(path, code) == 0;
  if (is_unfinished(path)) return fs::is_directory(checkpoints, code);
  return std::find(std::begin(kBeginning), std::end(kBeginning), name) != std::end(kBeginning) ||
         is_scenario_copy(path);
}

/// Removes of a barely begun run what is not written again as a whole; the later files first, so that it is still a
/// barely begun one where this is interrupted.
void remove_beginning(const fs::path& folder) {
  for (const fs::path& place : {folder, folder / kCheckpoints}) remove_temporaries(place);
  std::error_code code;
  for (const char* name : {kTensorBoardFile, kMetrics, kLog}) fs::remove(folder / name, code);
  std::vector<fs::path> copies;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code))
    if (is_scenario_copy(entry.path())) copies.push_back(entry.path());
  for (const fs::path& copy : copies) fs::remove(copy, code);
}

[[noreturn]] void fail_not_free(const fs::path& path) {
  std::error_code code;
  std::string what = "it holds no run";
  if (has_checkpoint(path))
    what = cat("to go on with it: gigastep resume ", shell_word(path.string()));
  else if (is_run_folder(path))
    what = "it holds no checkpoint to go on from, but files that a new run does not write or would lose";
  throw InputError(
      cat("the run folder ", path.string(), " is there already and not empty: a run is never overwritten; ", what));
}

/// Of the continuation with that number, from 1 on.
fs::path resume_file(const fs::path& folder, int number) {
  char name[32];
  std::snprintf(name, sizeof name, "resume_%03d.json", number);
  return folder / name;
}

/// A run is never overwritten. Returns whether one has barely begun there.
bool expect_free(const fs::path& path) {
  std::error_code code;
  if (const auto owner = lock_owner(path))
    throw InputError(cat("the run folder ", path.string(), " is in use by ", *owner));
  if (fs::is_empty(path, code)) return false;
  if (!is_barely_begun(path)) fail_not_free(path);
  return true;
}

}  // namespace

RunFolder RunFolder::create(const std::string& folder, const std::string& name) {
  fs::path path = folder;
  bool begun = false;
  if (!folder.empty()) {
    if (!make_folder(path)) begun = expect_free(path);
  } else {
    int number = 0;
    char text[16];
    do {
      if (++number > kMostRuns) throw InputError(cat("runs/", name, "-NNN: all numbers are taken"));
      std::snprintf(text, sizeof text, "-%03d", number);
      path = fs::path("runs") / (number == 1 ? name : name + text);
    } while (!make_folder(path));
  }
  RunFolder run(path);
  if (begun) {
    if (!is_barely_begun(path)) fail_not_free(path);  // another process was faster
    remove_beginning(path);
    run.begins_anew_ = true;
  }
  make_folder(path / kCheckpoints);
  return run;
}

RunFolder RunFolder::open(const std::string& folder) {
  std::error_code code;
  if (!fs::is_directory(folder, code)) throw InputError(cat("there is no run folder ", folder));
  if (!is_run_folder(folder)) throw InputError(cat(folder, " is not a run folder: it has no config.yaml"));
  RunFolder run(folder);
  for (const fs::path& place : {run.path_, run.path_ / kCheckpoints, run.path_ / kReplays}) remove_temporaries(place);
  return run;
}

fs::path RunFolder::checkpoint_file(int64_t updates) const {
  return path_ / kCheckpoints / name_of_update(updates, ".h5");
}
fs::path RunFolder::replay_file(int64_t updates) const {
  return path_ / kReplays / name_of_update(updates, kReplayEnding);
}
fs::path RunFolder::best_file() const { return path_ / kCheckpoints / kBest; }
fs::path RunFolder::events_file() const { return path_ / kTensorBoardFile; }

void RunFolder::describe(const std::string& config_yaml, const std::string& scenario_yaml, const Json& info,
                         const std::string& scenario_file_name) const {
  write_file(scenario_file(), scenario_yaml);
  if (!scenario_file_name.empty()) write_file(path_ / scenario_file_name, scenario_yaml);
  write_file(info_file(), json_text(info) + "\n");
  write_file(config_file(), config_yaml);
}

std::vector<std::string> RunFolder::describe_missing(const std::string& config_yaml, const std::string& scenario_yaml,
                                                     const Json& info, const std::string& scenario_file_name) const {
  std::vector<std::string> written;
  const auto restore = [&written](const fs::path& file, const std::string& text) {
    std::error_code code;
    if (fs::exists(file, code)) return;
    if (text.empty()) throw InputError(cat(file.string(), " is missing, and the checkpoint does not hold it"));
    write_file(file, text);
    written.push_back(file.filename().string());
  };
  restore(scenario_file(), scenario_yaml);
  if (!scenario_file_name.empty()) restore(path_ / scenario_file_name, scenario_yaml);
  restore(info_file(), json_text(info) + "\n");
  restore(config_file(), config_yaml);
  return written;
}

void RunFolder::describe_resume(const std::string& config_yaml, const Json& info) const {
  const auto before = static_cast<int>(list_resumes(path_).size());
  write_file(resume_file(path_, before + 1), json_text(info) + "\n");
  write_file(config_file(), config_yaml);
}

void RunFolder::save_replay(int64_t updates, const std::string& bytes) const {
  make_folder(path_ / kReplays);
  write_file(replay_file(updates), bytes);
}

std::vector<fs::path> RunFolder::replays(int64_t updates) const {
  std::vector<fs::path> files = checkpoints_in(path_ / kReplays, kReplayEnding);
  std::erase_if(files, [=](const fs::path& file) { return updates_of(file, kReplayEnding) > updates; });
  return files;
}

void RunFolder::save(const Checkpoint& checkpoint, int keep, bool is_best) const {
  const fs::path folder = path_ / kCheckpoints;
  remove_temporaries(folder);
  const std::string bytes = encode_checkpoint(checkpoint);
  // The best one first: whoever goes on from the checkpoint before finds the same best one again, and nobody would from
  // this one, which says that it has been kept.
  if (is_best) write_file(best_file(), bytes);
  write_file(checkpoint_file(checkpoint.updates), bytes);
  const std::vector<fs::path> files = checkpoints_in(folder);
  for (size_t k = 0; k + static_cast<size_t>(std::max(keep, 1)) < files.size(); ++k) {
    std::error_code code;
    fs::remove(files[k], code);
  }
}

namespace {

/// The last `n` names of a path: 2 of "/a/b/c" are "b/c".
std::string last_names(const fs::path& path, int n) {
  fs::path last;
  for (auto at = path.end(); n > 0 && at != path.begin(); --n) {
    --at;
    last = last.empty() ? *at : *at / last;
  }
  return last.string();
}

}  // namespace

std::vector<std::string> names_of_folders(const std::vector<fs::path>& folders) {
  std::vector<fs::path> named, places;  // as they are called, and where they are
  for (const fs::path& folder : folders) {
    fs::path whole = absolute_path(folder);
    places.push_back(fs::weakly_canonical(whole));
    named.push_back(std::move(whole));
  }
  std::vector<std::string> names;
  for (size_t k = 0; k < named.size(); ++k) {
    int n = 1;
    const auto is_shared = [&] {
      for (size_t j = 0; j < named.size(); ++j)
        if (places[j] != places[k] && last_names(named[j], n) == last_names(named[k], n)) return true;
      return false;
    };
    while (is_shared()) ++n;
    names.push_back(last_names(named[k], n));
  }
  return names;
}

std::vector<fs::path> list_resumes(const fs::path& folder) {
  std::vector<fs::path> files = {resume_file(folder, 1)};
  std::error_code code;
  while (fs::exists(files.back(), code)) files.push_back(resume_file(folder, static_cast<int>(files.size()) + 1));
  files.pop_back();
  return files;
}

bool is_run_folder(const fs::path& folder) {
  std::error_code code;
  return fs::is_regular_file(folder / "config.yaml", code) || has_checkpoint(folder);
}

bool is_barely_begun(const fs::path& folder) {
  std::error_code code;
  const fs::directory_iterator entries(folder, code);
  if (code || entries == fs::directory_iterator()) return false;
  if (!std::all_of(begin(entries), end(entries), [](const auto& e) { return is_of_beginning(e.path()); })) return false;
  // Nothing is there without what is written before it: a config.yaml alone is somebody's own.
  return std::is_partitioned(std::begin(kBeginning), std::end(kBeginning),
                             [&](const char* name) { return fs::exists(folder / name, code); });
}

void fail_no_such_run(const fs::path& path) {
  const fs::path folder = path.parent_path();
  std::vector<std::string> others;
  std::error_code code;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder.empty() ? "." : folder, code))
    others.push_back((folder / entry.path().filename()).string());
  std::sort(others.begin(), others.end());
  throw InputError(cat("there is no checkpoint or run folder ", path.string(), nearest_hint(path.string(), others)));
}

bool has_checkpoint(const fs::path& run_folder) {
  std::error_code code;
  return !list_checkpoints(run_folder).empty() || fs::exists(run_folder / kCheckpoints / kBest, code);
}

fs::path newest_checkpoint(const fs::path& run_folder) {
  const std::vector<fs::path> all = list_checkpoints(run_folder);
  return all.empty() ? run_folder / kCheckpoints / kBest : all.back();
}

std::vector<fs::path> list_checkpoints(const fs::path& run_folder) { return checkpoints_in(run_folder / kCheckpoints); }

namespace {

enum class Prefer : uint8_t { newest, best };

/// Where the newest checkpoint is damaged, the best one may be the same.
void take_if_newer(const fs::path& best, FoundCheckpoint& found) {
  try {
    Checkpoint checkpoint = read_checkpoint(best);
    if (checkpoint.updates <= found.checkpoint.updates) return;
    found.checkpoint = std::move(checkpoint);
    found.file = best;
  } catch (const InputError&) {  // nobody asked for it
  }
}

FoundCheckpoint find_preferred(const std::string& path, Prefer prefer) {
  std::error_code code;
  if (!fs::exists(path, code)) fail_no_such_run(path);
  FoundCheckpoint found;
  if (!fs::is_directory(path, code)) {
    found.file = path;
    found.checkpoint = read_checkpoint(path);
    return found;
  }
  fs::path folder = fs::path(path) / kCheckpoints;
  if (!fs::is_directory(folder, code)) folder = path;  // the folder of checkpoints itself was meant
  std::vector<fs::path> files = checkpoints_in(folder);
  // The last file is read first: best.h5 where it is preferred, else only if all others are broken, but see below.
  const fs::path best = folder / kBest;
  const bool has_best = fs::exists(best, code);
  if (has_best) files.insert(prefer == Prefer::best ? files.end() : files.begin(), best);
  for (; !files.empty(); files.pop_back()) {
    try {
      found.checkpoint = read_checkpoint(files.back());
      found.file = files.back();
      if (has_best && !found.damaged.empty() && found.file != best) take_if_newer(best, found);
      return found;
    } catch (const InputError& e) {
      found.damaged.emplace_back(e.what());
      found.damaged_files.push_back(files.back());
    }
  }
  if (found.damaged.empty())
    throw InputError(cat("the folder ", path, " holds no checkpoint (checkpoints/update_NNNNNNNN.h5)"));
  std::string all = cat("no checkpoint of ", path, " is whole:");
  for (const std::string& line : found.damaged) all += "\n  " + line;
  throw InputError(all);
}

}  // namespace

FoundCheckpoint find_checkpoint(const std::string& path) { return find_preferred(path, Prefer::newest); }
FoundCheckpoint find_best_checkpoint(const std::string& path) { return find_preferred(path, Prefer::best); }

std::string folder_name_of(const std::string& scenario) {
  const fs::path path = scenario;
  std::string name = path.extension() == ".yaml" ? path.stem().string() : path.filename().string();
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '-' && c != '.') c = '_';
  return name.empty() ? "run" : name;
}

}  // namespace giga
