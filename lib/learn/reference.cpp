// Kinds of files and the reference page.
#include "learn/reference.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "config/reference.hpp"
#include "learn/run_config_file.hpp"
#include "scenario/loader.hpp"

namespace giga {
namespace {

constexpr const char* kIntroduction = R"(# All keys of all files

A run config says how to train, a scenario says what is played. Both are YAML files that state
differences from the defaults below. `gigastep config --reference` writes this page from the same
lists that read the files. `gigastep config CONFIG` prints a config with all its values,
`gigastep scenarios show NAME` a scenario. In the tables a *group* is a map with keys of its own; a
table further down lists them under the path of the group. *Named groups* are a map from names of
your choice to such maps.

**Values.** An integer may be written `300000000`, `300_000_000` or `3e8`. `[0, 1]` is a range with
both ends, `[0, 1)` one without its end. `none`, or nothing at all, switches off what may be none.
Numbers are finite. A text needs quotes only where YAML would take it for something else.

**Changes.** `--set mappo.actor.hidden=[32,32]` replaces the value of one key. `environment.` before
a key of the scenario changes the scenario for this run.

**Strictness.** These are errors: an unknown key, a key given twice, a value of another type or out
of its limits, an anchor, alias or tag, a second document, bytes that are not UTF-8. All errors of a
run config and of the files that it names are listed together, each with file, line, column, value,
what is allowed and, where there is one, the nearest name. The program then ends with exit code 2
and has created nothing. [bad_input.md](bad_input.md) shows the messages.

**Editors.** `gigastep config --schema > run.schema.json` prints a JSON schema of run configs,
`--schema scenario` one of scenarios. An editor with the YAML language server completes keys and
marks mistakes if a config begins with `# yaml-language-server: $schema=run.schema.json`.
)";

/// The link to a section, as the usual renderers of Markdown name it.
std::string anchor(std::string title) {
  std::replace(title.begin(), title.end(), ' ', '-');
  return "#" + title;
}

}  // namespace

std::vector<FileKind> file_kinds() {
  return {
      {"run", "run config", "`gigastep train CONFIG`; examples are in `configs/`.", fields_of_default<RunConfigFile>()},
      {"scenario", "scenario", "Examples are in `scenarios/`; paths in it are relative to its file.",
       scenario_file_fields()},
      {"map", "map file", "A map in a file of its own, for `maps:` of a scenario.", fields_of_default<Map>()},
      {"agent_type", "agent type file", "An agent type in a file of its own, for `type:` of a team.",
       fields_of_default<AgentType>()},
      {"agent_types", "agent types file", "`scenarios/agent_types.yaml`, which every scenario knows.",
       agent_types_file_fields()}};
}

std::string reference_page() {
  std::string contents, sections;
  for (const FileKind& kind : file_kinds()) {
    contents += "- [" + capitalised(kind.title) + "](" + anchor(kind.title) + "): " + kind.about + "\n";
    sections += "\n## " + capitalised(kind.title) + "\n\n" +
                reference_tables(kind.defaults, "###", "[keys of a scenario](" + anchor("scenario") + ")");
  }
  return kIntroduction + ("\n" + contents) + sections;
}

}  // namespace giga
