#include "learn/players/mixed_team.hpp"

#include <algorithm>

#include "config/names.hpp"
#include "core/error.hpp"
#include "learn/opponents/world_shares.hpp"
#include "learn/players/player.hpp"

namespace giga {
namespace fs = std::filesystem;
namespace {

class MixedController final : public TeamController {
 public:
  explicit MixedController(std::vector<std::shared_ptr<TeamController>> members) : members_(std::move(members)) {
    for (const auto& member : members_) {
      const int64_t size = member->memory_size();
      if (size > 0 && memory_size_ > 0 && size != memory_size_)
        throw InputError(cat("its policies remember ", memory_size_, " and ", size,
                             " numbers; all that remember must remember as many"));
      memory_size_ = std::max(memory_size_, size);
    }
  }

  ObservationSet reads() const override {
    ObservationSet all = members_.front()->reads();
    for (const auto& member : members_) all |= member->reads();
    return all;
  }
  int64_t memory_size() const override { return memory_size_; }
  bool repeats() const override {
    return std::all_of(members_.begin(), members_.end(), [](const auto& member) { return member->repeats(); });
  }
  void act(std::span<const TeamStep> parts) override {
    const auto n = static_cast<int64_t>(members_.size());
    std::vector<TeamStep> own;
    for (int64_t k = 0; k < n; ++k) {
      own.clear();
      for (const TeamStep& part : parts) {
        const WorldRange worlds = part_of(part.worlds, k, n);
        if (worlds.count == 0) continue;
        own.push_back(part.part(worlds));
        own.back().buffers.pre_tanh_action = own.back().buffers.log_prob = nullptr;
        own.back().behind_step = false;  // other members' work may lie between
      }
      if (!own.empty()) members_[static_cast<size_t>(k)]->act(own);
    }
  }

 private:
  const std::vector<std::shared_ptr<TeamController>> members_;
  int64_t memory_size_ = 0;
};

}  // namespace

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
    throw InputError(cat(e.what(), "\n", file.string(),
                         ": a .yaml file in the place of a policy is a mixed team, as policies: [runs/first, circle]"));
  }
  const auto found = given.find("policies");
  if (found == given.end())
    throw InputError(cat(file.string(), ": policies: is missing; a mixed team lists who plays in it"));
  team.at = found->second.text();
  const fs::path folder = fs::absolute(file).parent_path();
  for (std::string& policy : team.policies)
    if (policy.find_first_of("/.") != std::string::npos)
      policy = fs::weakly_canonical(folder / policy).string();
    else if (!find_script(policy))
      throw InputError(cat(team.at, ": policies: '", policy, "' is no script",
                           nearest_hint(policy, FieldCodec<Scripted>::names()),
                           "; the path of a policy has a slash or a dot, as ./", policy));
  return team;
}

std::string print_mixed_team(const MixedTeam& team) { return print_yaml(team, false); }

std::unique_ptr<TeamController> mixed_controller(std::vector<std::shared_ptr<TeamController>> members) {
  return std::make_unique<MixedController>(std::move(members));
}

}  // namespace giga
