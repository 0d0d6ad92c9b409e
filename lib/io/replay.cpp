// Replays as bytes: a line of text, then one zlib stream: the header as JSON, and the columns of each episode.
#include "io/replay.hpp"

#include <zlib.h>

#include <algorithm>

#include "core/error.hpp"
#include "io/deflate.hpp"
#include "io/inflater.hpp"
#include "io/replay_columns.hpp"
#include "io/replay_header.hpp"

namespace giga {
namespace {

constexpr std::string_view kMagic = "gigastep replay ";
constexpr size_t kMostHeader = size_t{16} << 20;  // its episodes have some kilobytes of events each

/// The number behind the magic; -1 where there is none.
int format_of(std::string_view line) {
  int version = 0;
  for (const char c : line) {
    if (c < '0' || c > '9' || version > 1'000'000) return -1;
    version = 10 * version + (c - '0');
  }
  return line.empty() ? -1 : version;
}

}  // namespace

int Replay::n_team(int team) const {
  return static_cast<int>(std::count_if(agents.begin(), agents.end(), [=](const auto& a) { return a.team == team; }));
}

float place_unit(float longer_side, int n_agents) {
  return n_agents > kMostPaired ? std::max(longer_side / kCrowdPlaces, kCrowdPlace) : longer_side / kReplayPlaces;
}

float health_unit(float most_health) { return std::max(most_health / kReplayHealths, kReplayHealth); }

float Replay::place_unit() const { return giga::place_unit(std::max(rules.limit_x, rules.limit_y), n_agents()); }

uint32_t crc32_of(std::string_view bytes, uint32_t before) {
  return static_cast<uint32_t>(::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

int64_t action_checksum(const Replay& replay, const ReplayEpisode& episode) {
  const std::string_view actions(reinterpret_cast<const char*>(episode.action.data()), episode.action.size());
  return crc32_of(actions, crc32_of(replay.seed));
}

std::string too_large_to_keep(const Replay& frame, int64_t episodes, int most_steps) {
  if (frame.n_agents() > kMostReplayAgents)
    return cat("scenario '", frame.scenario_name, "' has ", frame.n_agents(),
               " agents in a world; replays hold games of at most ", kMostReplayAgents);
  ReplayEpisode longest;
  longest.steps = most_steps;
  const EpisodeSizes sizes(frame, longest);
  const size_t fire = frame.is_crowd() ? sizes.agents * sizes.steps / kStepsPerFire * kFireBytes : 0;
  const size_t most = kMostReplayBytes / (sizes.all(frame, longest) + fire);
  if (static_cast<size_t>(episodes) > most)
    return cat("a replay has room for ", most, " of these games, not for ", episodes);
  return "";
}

std::string encode_replay(const Replay& replay) {
  const std::string wrong = broken_header(replay);
  GIGA_CHECK(wrong.empty(), "the replay ", wrong);
  const std::string json = header_text(replay);
  if (json.size() > kMostHeader)
    throw InputError(
        cat("the events of ", replay.episodes.size(), " games are more than a replay has room for; fewer fit"));
  std::string raw;
  for (size_t byte = 0; byte < 4; ++byte) raw += static_cast<char>(json.size() >> (8 * byte) & 255);
  raw += json;
  std::vector<size_t> ends{raw.size()};
  for (const ReplayEpisode& episode : replay.episodes) put_columns(replay, episode, raw, ends);
  return cat(kMagic, replay.is_crowd() ? kCrowdFormat : kReplayFormat, '\n') + deflated(raw, ends);
}

Replay decode_replay(std::string_view bytes, const std::string& name) {
  if (bytes.empty()) throw InputError(name + " is empty");
  const size_t end = bytes.substr(0, 40).find('\n');
  if (bytes.substr(0, kMagic.size()) != kMagic || end == std::string_view::npos)
    throw InputError(name + " is no replay: it does not begin as one (gigastep record writes them)");
  const int version = format_of(bytes.substr(kMagic.size(), end - kMagic.size()));
  if (version < 1) throw InputError(name + " is damaged: its first line makes no sense");
  if (version > kCrowdFormat)
    throw InputError(
        cat(name, " has format version ", version, ", newer than ", kCrowdFormat, ", which this gigastep reads"));
  if (version < kReplayFormat)
    throw InputError(cat(name, " has format version ", version,
                         ", of gigastep before its first release; this one reads ", kReplayFormat, " and ",
                         kCrowdFormat));
  Inflater stream(bytes.substr(end + 1), name);
  const size_t header_size = number_of(stream.take(4));
  if (header_size > kMostHeader) throw InputError(cat(name, " is damaged: a header of ", header_size, " bytes"));
  Replay replay = read_header(stream.take(header_size), name, version);
  size_t fire_bytes = 0;
  for (size_t k = 0; k < replay.episodes.size(); ++k) {
    ReplayEpisode& episode = replay.episodes[k];
    const std::string columns = stream.take(EpisodeSizes(replay, episode).all(replay, episode));
    std::string wrong = read_columns(replay, columns, episode);
    if (wrong.empty() && replay.is_crowd()) {
      const size_t count = number_of(stream.take(kCountBytes));
      fire_bytes += kFireBytes * count;
      if (fire_bytes > kMostReplayBytes)
        throw InputError(cat(name, " asks for more than ", kMostReplayBytes >> 20, " MiB"));
      const std::string lines = stream.take(kFireBytes * count);
      wrong = read_fire(replay, count, lines, episode);
    }
    if (!wrong.empty()) throw InputError(cat(name, " is damaged: episode ", k, " ", wrong));
    if (action_checksum(replay, episode) != episode.action_check)
      throw InputError(cat(name, " is damaged: the actions of episode ", k, " do not have their checksum"));
  }
  stream.finish();
  return replay;
}

}  // namespace giga
