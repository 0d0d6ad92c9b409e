#include "learn/opponents/frozen_opponent.hpp"

#include "core/error.hpp"
#include "io/crc32c.hpp"
#include "io/files.hpp"

namespace giga {
namespace {

constexpr const char* kFingerprint = "opponent/crc32c";

/// Where it cannot play the run's game, the message says where it was named.
Player load_opponent(const LoadedRun& run, Device device) {
  try {
    Player player = Player::load(run.config.train.opponent.name, {.device = device});
    player.check_plays(run.spec, &run.scenario);
    player.controller(1 - run.config.train.learning_team, run.spec);  // refuses a team of which it has no policy
    return player;
  } catch (const InputError& e) {
    if (!run.opponent_at) throw;
    Errors errors;
    errors.add(*run.opponent_at, cat("train.opponent: ", e.what()));
    throw InputError(errors.text());
  }
}

/// Of its file; 0 where it has none.
int64_t crc_of(const Player& player) { return player.origin() ? crc32c(read_file(player.origin()->file)) : 0; }

int64_t fingerprint_of(const Player& player) {
  if (!player.is_mixed()) return crc_of(player);
  std::string lines;  // who plays, in their order
  for (const Player* member : player.members())
    lines += cat(member->script() ? member->name() : std::to_string(crc_of(*member)), "\n");
  return crc32c(lines);
}

}  // namespace

FrozenOpponent::FrozenOpponent(const LoadedRun& run, Device device)
    : player_(load_opponent(run, device)), fingerprint_(fingerprint_of(player_)) {}

Side FrozenOpponent::side(int team, const LoadedRun& run, const WorldShares& worlds, const Simulator& sim) {
  const std::shared_ptr<TeamController> controller = player_.controller(team, run.spec);
  if (!player_.is_mixed()) return everywhere(controller, sim);
  Side shards;  // each is divided among the members alike, so that it does not matter which rank has it
  for (int64_t k = 0; k < worlds.n_shards; ++k) shards.push_back({controller, worlds.self_play().of(k)});
  return shards;
}

void FrozenOpponent::save(NamedArrays& out) const { out.push_back(make_array<int64_t>(kFingerprint, {fingerprint_})); }

void FrozenOpponent::check_same(const NamedArrays& in) const {
  if (array_values<int64_t>(find_array(in, kFingerprint)).at(0) == fingerprint_) return;
  throw InputError(cat("train.opponent: ", player_.name(),
                       " holds another policy than when this run began; keep a copy of a checkpoint to learn against"));
}

}  // namespace giga
