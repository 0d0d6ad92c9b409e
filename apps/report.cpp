// gigastep report: a page with the learning curves, figures and settings of one or several runs.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>

#include "apps/commands.hpp"
#include "apps/output.hpp"
#include "core/error.hpp"
#include "learn/run_config.hpp"
#include "report/report.hpp"

namespace giga {

void add_report_command(CLI::App& app, Dispatch& dispatch) {
  struct Options {
    std::vector<std::string> runs;
    std::string out;
  };
  CLI::App* command = app.add_subcommand("report", "write a page with the learning curves of one or several runs");
  auto options = std::make_shared<Options>();
  command->add_option("RUN", options->runs, "run folders")->required()->type_name("");
  command->add_option("--out", options->out, "the page; default: report.html in the run folder, of several runs here")
      ->check(output(Output::file))
      ->check(CLI::Validator(
          [](const std::string& out) {
            return out.ends_with(".html") || out.ends_with(".htm") ? "" : cat("'", out, "' is no .html file");
          },
          "", "a page"))
      ->type_name("FILE.html");
  command->footer(
      "The page opens in any browser and needs no network. Runs that differ only in their seed become one curve, the\n"
      "mean, with a band from the smallest to the largest; other runs are compared, labelled by what differs. A run "
      "may\n"
      "still be going on. Folders that are no runs, or have no figures yet, are left out with a warning.\n"
      "Examples:\n"
      "  gigastep report runs/NAME\n"
      "  gigastep report runs/NAME-seed* --out seeds.html\n"
      "  gigastep report runs/*/ --out all.html");
  command->callback([options, &dispatch] {
    dispatch.uses_threads = false;
    dispatch.run = [options] {
      namespace fs = std::filesystem;
      const std::vector<fs::path> runs(options->runs.begin(), options->runs.end());
      const fs::path usual = runs.size() == 1 ? runs[0] / "report.html" : fs::path("report.html");
      const fs::path out = options->out.empty() ? usual : fs::path(options->out);
      for (const std::string& line : write_report(runs, out, list_fields<RunConfig>()))
        std::cerr << "warning: " << line << "; it is left out\n";
      std::cout << out.string() << std::endl;
    };
  });
}

}  // namespace giga
