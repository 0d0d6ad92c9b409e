// The commands of gigastep, each in the file of its name.
#pragma once

#include <functional>
#include <string>

namespace CLI {
class App;
}

namespace giga {

/// Exit codes of all commands, beside kOutOfTime (training.hpp) and 128 + a signal.
constexpr int kFailed = 1, kBadInput = 2, kDiverged = 3;

/// What the command line asked for; main carries it out once all of the line is understood.
struct Dispatch {
  std::function<void()> run;
  bool uses_threads = true;  ///< `run` lets threads of LibTorch work (openmp_spin.hpp)
  int exit_code = 0;         ///< where `run` returns; errors have their own
  std::string size_key;      ///< the setting that makes the run smaller (RunSize), once a run is known
  /// What to do after a failure, for people; may be empty.
  std::function<std::string()> advice;
  std::string who;  ///< before messages of failures: "rank 1: "; empty where the process is alone
  /// Tells the other ranks of a failure; may be empty.
  std::function<void(const std::string&)> tell_ranks;
};

void add_train_command(CLI::App& app, Dispatch& dispatch);
void add_resume_command(CLI::App& app, Dispatch& dispatch);
void add_inspect_command(CLI::App& app, Dispatch& dispatch);
void add_eval_command(CLI::App& app, Dispatch& dispatch);
void add_export_command(CLI::App& app, Dispatch& dispatch);
void add_scenarios_command(CLI::App& app, Dispatch& dispatch);
void add_config_command(CLI::App& app, Dispatch& dispatch);
void add_bench_command(CLI::App& app, Dispatch& dispatch);
void add_report_command(CLI::App& app, Dispatch& dispatch);
void add_rate_command(CLI::App& app, Dispatch& dispatch);
void add_sweep_command(CLI::App& app, Dispatch& dispatch);
void add_exploit_command(CLI::App& app, Dispatch& dispatch);
void add_record_command(CLI::App& app, Dispatch& dispatch);
void add_play_command(CLI::App& app, Dispatch& dispatch);
void add_picture_command(CLI::App& app, Dispatch& dispatch);

}  // namespace giga
