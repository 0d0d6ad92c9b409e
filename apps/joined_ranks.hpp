// JoinedRanks: how `train` and `resume` work as one of several processes.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/commands.hpp"
#include "core/memory.hpp"
#include "learn/run_config.hpp"
#include "ranks/ranks.hpp"

namespace giga {

struct RankOptions {
  std::optional<int> ranks, gpus;  ///< processes to start on this machine: any, or with a GPU each; one of both at most
  int timeout = 600;               ///< seconds
  const char* device_option = "--device cpu";  ///< that makes the command compute on the CPU

  /// How many processes are to be started; 1: none.
  int to_start() const { return gpus.value_or(ranks.value_or(1)); }
  /// "--gpus 2"
  std::string text() const;
};
void add_rank_options(CLI::App& command, RankOptions& options);

/// The ranks of this process; null: it is alone.
struct JoinedRanks {
  std::shared_ptr<Ranks> ranks;
  int gpu = 0;

  bool leads() const { return !ranks || ranks->leads(); }
  int size() const { return ranks ? ranks->size() : 1; }
};

/// Meets the ranks that torchrun, srun or `--ranks` have started; from then on they learn of a failure here.
JoinedRanks join_others(const RankOptions& options, Dispatch& dispatch);

/// The device of this rank: each has the GPU of its number on its machine. Throws InputError where it is not there.
Device device_of_rank(const std::string& device, const JoinedRanks& joined);

/// Throws InputError where the ranks that are to be started would lack GPUs. `device`: of this process.
void expect_devices(const RankOptions& options, const std::string& asked, Device device);

/// The assignment of a setting without which so many ranks could not share the run, where nobody has set it; else
/// empty.
std::string setting_for_ranks(const RunConfig& config, const std::vector<std::string>& overrides, int n_ranks);

/// Throws InputError where the ranks do not have the same text; `what` it is: "config".
void expect_same(Ranks* ranks, const std::string& what, const std::string& text);

/// What ranks must have in common: program, config and scenario.
std::string described(const LoadedRun& run);

/// After the last update: lets the others end too. Returns the code.
int finish(const JoinedRanks& joined, int code);

/// The code with which to stop: that of the first rank which wants to. 0 = nobody does.
int agreed_stop(Ranks* ranks, int code);
/// What rank 0 has decided.
bool as_rank_0_says(Ranks* ranks, bool decision);

}  // namespace giga
