// gigastep: reads the command line, runs the command, and turns every error into a message and an exit code.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "apps/command_line.hpp"
#include "apps/commands.hpp"
#include "apps/openmp_spin.hpp"
#include "apps/program_info.hpp"
#include "core/error.hpp"
#include "core/out_of_memory.hpp"

namespace {

using giga::kBadInput, giga::kDiverged, giga::kFailed;

int exit_code(const giga::Error& error) {
  switch (error.kind()) {
    case giga::ErrorKind::input:
      return kBadInput;
    case giga::ErrorKind::diverged:
      return kDiverged;
    case giga::ErrorKind::internal:
      break;
  }
  return kFailed;
}

int fail(const std::string& message, int code) {
  std::cerr << "gigastep: " << message << std::endl;
  return code;
}

/// LibTorch puts pages of stack behind its messages.
std::string without_stack(const std::string& message) {
  return message.substr(0, std::min(message.find("\nException raised from"), message.find("\nframe #0")));
}

/// What helps where memory ran out, on any device.
std::string with_advice(const std::string& message, const std::string& size_key) {
  if (!giga::tells_of_memory(message)) return message;
  const std::string smaller = size_key.empty() ? "" : "; a smaller " + size_key + " takes less";
  return message + "\n`gigastep train CONFIG --plan` measures what a run takes and what fits" + smaller;
}

int run(int argc, char** argv, giga::Dispatch& dispatch) {
  CLI::App app("gigastep: fast training of teams of agents against each other.", "gigastep");
  giga::describe_program(app);
  giga::add_train_command(app, dispatch);
  giga::add_resume_command(app, dispatch);
  giga::add_eval_command(app, dispatch);
  giga::add_export_command(app, dispatch);
  giga::add_inspect_command(app, dispatch);
  giga::add_scenarios_command(app, dispatch);
  giga::add_config_command(app, dispatch);
  giga::add_bench_command(app, dispatch);
  giga::add_report_command(app, dispatch);
  giga::add_rate_command(app, dispatch);
  giga::add_sweep_command(app, dispatch);
  giga::add_exploit_command(app, dispatch);
  giga::add_record_command(app, dispatch);
  giga::add_play_command(app, dispatch);
  giga::add_picture_command(app, dispatch);
  std::vector<std::string> arguments = giga::help_in_words(app, {argv + 1, argv + argc});
  std::reverse(arguments.begin(), arguments.end());  // as CLI11 wants them
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help, --version
    return fail(giga::explain(app, e), kBadInput);
  }
  if (dispatch.uses_threads) giga::restart_with_short_spin(argv);
  dispatch.run();
  return dispatch.exit_code;
}

/// The whole program; its exit code.
int run_and_report(int argc, char** argv) {
  giga::Dispatch dispatch;
  const auto advised = [&dispatch](const std::string& message) {
    const std::string advice = dispatch.advice ? dispatch.advice() : "";
    return with_advice(message, dispatch.size_key) + (advice.empty() ? "" : "\n" + advice);
  };
  const auto fail_here = [&dispatch](const std::string& message, int code) {
    fail(dispatch.who + message, code);
    if (dispatch.tell_ranks) dispatch.tell_ranks(message);
    return code;
  };
  try {
    return run(argc, argv, dispatch);
  } catch (const giga::Error& e) {
    const int code = exit_code(e);
    return fail_here(code == kFailed ? advised(e.what()) : with_advice(e.what(), dispatch.size_key), code);
  } catch (const std::bad_alloc&) {
    return fail_here(advised("out of memory"), kFailed);
  } catch (const std::exception& e) {
    return fail_here(advised(without_stack(e.what())), kFailed);
  }
}

}  // namespace

int main(int argc, char** argv) {
  int code = run_and_report(argc, argv);
  // What was printed may have been the result; a full disk must not look like success.
  std::cout.flush();
  if ((std::fflush(stdout) != 0 || std::ferror(stdout) || !std::cout) && code == 0 && errno != EPIPE)
    code = fail("the output could not be written", kFailed);
  // Without the destructors of LibTorch's tables of operators, which take a quarter of a short command's time.
  std::fflush(nullptr);
  std::_Exit(code);
}
