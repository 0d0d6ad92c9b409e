#include "apps/joined_ranks.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <sstream>

#include "apps/option_value.hpp"
#include "apps/program_info.hpp"
#include "core/error.hpp"
#include "cuda/runtime.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

/// The first line in which two texts differ: "train.n_threads: 1 instead of 2".
std::string first_difference(const std::string& a, const std::string& b) {
  std::istringstream left(a), right(b);
  std::string one, other;
  for (;;) {
    const bool more_left = static_cast<bool>(std::getline(left, one)), more_right = !!std::getline(right, other);
    if (!more_left && !more_right) return "";
    if (!more_left) one = "nothing";
    if (!more_right) other = "nothing";
    if (one != other) return cat("'", other, "' instead of '", one, "'");
  }
}

}  // namespace

std::string RankOptions::text() const { return gpus ? cat("--gpus ", *gpus) : cat("--ranks ", ranks.value_or(1)); }

void add_rank_options(CLI::App& command, RankOptions& options) {
  CLI::Option* ranks =
      command
          .add_option("--ranks", options.ranks,
                      "by so many processes on this machine: with GPUs each has its own, without they share the cores "
                      "(docs/scale.md; torchrun and srun need no option)")
          ->transform(value_of<int>(range(1, 256)))
          ->type_name("N");
  command.add_option("--gpus", options.gpus, "by so many GPUs of this machine: as --ranks, but refused without them")
      ->transform(value_of<int>(range(1, 256)))
      ->type_name("N")
      ->excludes(ranks);
  command
      .add_option("--rank-timeout", options.timeout,
                  "of several ranks: seconds for which one that lives is waited for; more than an evaluation takes")
      ->transform(value_of<int>(range(1, 1'000'000)))
      ->capture_default_str()
      ->type_name("SECONDS");
}

JoinedRanks join_others(const RankOptions& options, Dispatch& dispatch) {
  const std::optional<RankPlace> place = rank_place([](const char* name) { return std::getenv(name); });
  if (!place) return {};
  if (options.ranks || options.gpus)
    throw InputError(cat(options.text(), ": this process is rank ", place->rank, " of ", place->size,
                         " already, as its variables say (torchrun, srun); leave the option out"));
  RankPatience patience;
  patience.answer = std::chrono::seconds(options.timeout);
  dispatch.who = cat("rank ", place->rank, ": ");
  const std::shared_ptr<Ranks> ranks = join_ranks(*place, patience);
  dispatch.tell_ranks = [ranks](const std::string& message) { ranks->report_failure(message); };
  return {ranks, place->gpu(cuda_device_count())};
}

Device device_of_rank(const std::string& device, const JoinedRanks& joined) {
  const Device found = parse_device(device);
  if (!joined.ranks || !found.is_cuda()) return found;
  if (device.starts_with("cuda:"))
    throw InputError(cat("device ", device, ": several ranks have a GPU each, by their number; write cuda"));
  return parse_device(cat("cuda:", joined.gpu));
}

void expect_devices(const RankOptions& options, const std::string& asked, Device device) {
  if (!device.is_cuda()) {
    if (!options.gpus) return;
    if (asked == "cpu") throw InputError(cat(options.text(), ": the device is cpu; --ranks shares the cores"));
    throw InputError(cat(options.text(), ": no GPU is found; --ranks ", *options.gpus, " shares the cores"));
  }
  if (asked.starts_with("cuda:") && options.to_start() > 1)
    throw InputError(cat("device ", asked, ": several ranks have a GPU each, by their number; write cuda"));
  if (const int found = cuda_device_count(); found < options.to_start())
    throw InputError(cat(options.text(), ": ", counted(found, "GPUs"), found == 1 ? " is" : " are",
                         " found, and each rank needs one; --ranks ", options.to_start(), " with ",
                         options.device_option, " shares the cores"));
}

std::string setting_for_ranks(const RunConfig& config, const std::vector<std::string>& overrides, int n_ranks) {
  const auto setting = algorithm_of(config).setting_for_ranks;
  const std::string assignment = setting && n_ranks > 1 ? setting(config, n_ranks) : "";
  const std::string key = assignment.substr(0, assignment.find('='));
  const auto sets_it = [&key](const std::string& o) { return o.substr(0, o.find('=')) == key; };
  return std::any_of(overrides.begin(), overrides.end(), sets_it) ? "" : assignment;
}

void expect_same(Ranks* ranks, const std::string& what, const std::string& text) {
  if (!ranks) return;
  const std::vector<std::string> all = ranks->gather(text);
  for (size_t rank = 1; rank < all.size(); ++rank)
    if (all[rank] != all[0])
      throw InputError(
          cat("rank ", rank, " has another ", what, " than rank 0: ", first_difference(all[0], all[rank])));
}

std::string described(const LoadedRun& run) {
  return cat("gigastep ", program_version(), '\n', print_yaml(run.config, false), print_scenario(run.scenario));
}

int finish(const JoinedRanks& joined, int code) {
  if (joined.ranks) joined.ranks->leave();
  return code;
}

int agreed_stop(Ranks* ranks, int code) {
  if (!ranks) return code;
  const std::vector<std::string> codes = ranks->gather(std::to_string(code));
  const auto first = std::find_if(codes.begin(), codes.end(), [](const std::string& c) { return c != "0"; });
  return first == codes.end() ? 0 : std::stoi(*first);
}

bool as_rank_0_says(Ranks* ranks, bool decision) {
  return ranks ? ranks->broadcast(decision ? "yes" : "no") == "yes" : decision;
}

}  // namespace giga
