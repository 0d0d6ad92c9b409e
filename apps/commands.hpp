// The commands of gigastep, each in the file of its name.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace giga {

/// What the command line asked for; main carries it out once all of the line is understood.
struct Dispatch {
  std::function<void()> run;
};

void add_train_command(CLI::App& app, Dispatch& dispatch);
void add_eval_command(CLI::App& app, Dispatch& dispatch);
void add_scenarios_command(CLI::App& app, Dispatch& dispatch);
void add_config_command(CLI::App& app, Dispatch& dispatch);
void add_bench_command(CLI::App& app, Dispatch& dispatch);

}  // namespace giga
