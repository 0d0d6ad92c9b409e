#include "learn/mixed_team.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "core/error.hpp"
#include "learn/run_config.hpp"
#include "learn/yaml_kind.hpp"
#include "scripted/script.hpp"

namespace giga {
namespace fs = std::filesystem;

bool names_mixed_team(const fs::path& file) {
  std::error_code code;
  return (file.extension() == ".yaml" || file.extension() == ".yml") && !fs::is_directory(file, code);
}

MixedTeam read_mixed_team(const fs::path& file) {
  MixedTeam team;
  Errors errors;
  KeyPositions given;
  read_config_file(file, {}, team, errors, &given);
  try {
    errors.throw_if_any();
  } catch (const InputError& e) {
    if (const std::string other = not_asked_for(file, YamlKind::mixed_team); !other.empty()) throw InputError(other);
    throw InputError(cat(e.what(), "\n", file.string(),
                         ": a .yaml file in the place of a policy is a mixed team, as policies: [runs/first, circle]"));
  }
  const auto found = given.find("policies");
  if (found == given.end())
    throw InputError(cat(file.string(), ": policies: is missing; a mixed team lists who plays in it"));
  team.at = found->second.text();
  const fs::path folder = fs::absolute(file).parent_path();
  const std::vector<std::string> scripts = FieldCodec<Scripted>::names();
  for (std::string& policy : team.policies)
    if (policy.find_first_of("/.") != std::string::npos)
      policy = fs::weakly_canonical(folder / policy).string();
    else if (std::find(scripts.begin(), scripts.end(), policy) == scripts.end())
      throw InputError(cat(team.at, ": policies: '", policy, "' is no script", nearest_hint(policy, scripts),
                           "; the path of a policy has a slash or a dot, as ./", policy));
  return team;
}

std::string print_mixed_team(const MixedTeam& team) { return print_yaml(team, false); }

}  // namespace giga
