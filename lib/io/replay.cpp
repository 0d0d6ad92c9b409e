// Replays as bytes: a line of text, then one zlib stream: the header as JSON, and the columns of each episode.
#include "io/replay.hpp"

#include <zlib.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "io/deflate.hpp"
#include "io/json.hpp"

namespace giga {
namespace {

constexpr std::string_view kMagic = "gigastep replay ";
constexpr size_t kMostHeader = size_t{4} << 20, kMostBytes = size_t{1} << 30;
constexpr int kMostAgents = 1024;

/// How a column of states is kept: each number less what the one before it (order 1), or the two before it (order 2),
/// let expect.
constexpr struct {
  std::vector<int16_t> ReplayEpisode::*column;
  int order;
} kStates[] = {{&ReplayEpisode::x, 2},       {&ReplayEpisode::y, 2},     {&ReplayEpisode::z, 1},
               {&ReplayEpisode::heading, 1}, {&ReplayEpisode::speed, 1}, {&ReplayEpisode::health, 1}};

/// Number of bytes of each part of an episode, from what the header says.
struct EpisodeSizes {
  size_t states, agents, steps, state_numbers, action_bytes, opponents, mates;

  EpisodeSizes(const Replay& replay, const ReplayEpisode& episode)
      : states(static_cast<size_t>(episode.steps) + 1),
        agents(replay.agents.size()),
        steps(static_cast<size_t>(episode.steps)),
        state_numbers(agents * states),
        action_bytes(agents * steps *
                     (replay.actions == ReplayActions::discrete ? 1 : sizeof(float) * kReplayControls)),
        opponents(static_cast<size_t>(ReplayPairs(replay).n_opponents()) * bit_bytes()),
        mates(replay.has_hearing() ? static_cast<size_t>(ReplayPairs(replay).n_mates()) * bit_bytes() : 0) {}

  size_t bit_bytes() const { return (states + 7) / 8; }
  size_t mind(const Replay& replay, const ReplayEpisode& episode, int team) const {
    const ReplayMind& mind = episode.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_team(team)) * states;
    return values(mind, rows) + likely(replay, mind, rows) + probabilities(replay, mind, rows);
  }
  static size_t values(const ReplayMind& mind, size_t rows) { return mind.low < mind.high ? rows : 0; }
  static size_t likely(const Replay& replay, const ReplayMind& mind, size_t rows) {
    const size_t per_row = replay.actions == ReplayActions::discrete ? static_cast<size_t>(mind.top)
                           : mind.top                                ? kReplayControls
                                                                     : 0;
    return rows * per_row;
  }
  static size_t probabilities(const Replay& replay, const ReplayMind& mind, size_t rows) {
    return replay.actions == ReplayActions::discrete ? rows * static_cast<size_t>(mind.top) : 0;
  }
  size_t all(const Replay& replay, const ReplayEpisode& episode) const {
    return std::size(kStates) * 2 * state_numbers + action_bytes + 2 * opponents + mates + mind(replay, episode, 0) +
           mind(replay, episode, 1);
  }
};

uint16_t expected_number(const std::vector<int16_t>& column, size_t k, size_t at, int order) {
  const auto before = [&](size_t back) { return static_cast<uint16_t>(column[k - back]); };
  if (at == 0) return 0;
  if (order == 1 || at == 1) return before(1);
  return static_cast<uint16_t>(2 * before(1) - before(2));
}

/// Differences as 0, -1, 1, -2, 2, ... = 0, 1, 2, 3, 4, ...; all low bytes, then all high ones.
void put_states(const std::vector<int16_t>& column, size_t states, int order, std::string& out) {
  const size_t low = out.size();
  out.resize(low + 2 * column.size());
  for (size_t k = 0; k < column.size(); ++k) {
    const uint16_t expected = expected_number(column, k, k % states, order);
    const auto apart = static_cast<int16_t>(static_cast<uint16_t>(column[k]) - expected);
    const auto folded = static_cast<uint16_t>(apart < 0 ? -2 * apart - 1 : 2 * apart);
    out[low + k] = static_cast<char>(folded & 255);
    out[low + column.size() + k] = static_cast<char>(folded >> 8);
  }
}

/// Reads parts of bytes whose number was checked before.
class Parts {
 public:
  explicit Parts(std::string_view bytes) : rest_(bytes) {}

  std::string_view take(size_t size) {
    GIGA_CHECK(size <= rest_.size(), size, " of ", rest_.size(), " bytes");
    const std::string_view part = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return part;
  }
  std::vector<uint8_t> bytes(size_t size) {
    const std::string_view part = take(size);
    return {part.begin(), part.end()};
  }
  std::vector<int16_t> states(size_t count, size_t states, int order) {
    const std::string_view part = take(2 * count);
    std::vector<int16_t> column(count);
    for (size_t k = 0; k < count; ++k) {
      const int folded = static_cast<unsigned char>(part[k]) | static_cast<unsigned char>(part[count + k]) << 8;
      const int apart = folded & 1 ? -(folded + 1) / 2 : folded / 2;
      column[k] = static_cast<int16_t>(expected_number(column, k, k % states, order) + apart);
    }
    return column;
  }

 private:
  std::string_view rest_;
};

void append(const std::vector<uint8_t>& bytes, std::string& out) { out.append(bytes.begin(), bytes.end()); }

/// A zlib stream that is read piece by piece, so that a small file cannot ask for all memory.
class Inflater {
 public:
  Inflater(std::string_view bytes, const std::string& name) : name_(name) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    GIGA_CHECK(inflateInit(&stream_) == Z_OK, "zlib");
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
  ~Inflater() { inflateEnd(&stream_); }

  /// The next `size` bytes. They are claimed as they come.
  std::string take(size_t size) {
    std::string out;
    while (out.size() < size) {
      const size_t before = out.size(), piece = std::min(size - before, size_t{1} << 20);
      out.resize(before + piece);
      stream_.next_out = reinterpret_cast<Bytef*>(out.data() + before);
      stream_.avail_out = static_cast<uInt>(piece);
      while (stream_.avail_out > 0) step();
    }
    return out;
  }
  /// Nothing may be left, and the checksum at the end must be right.
  void finish() {
    char one = 0;
    stream_.next_out = reinterpret_cast<Bytef*>(&one);
    stream_.avail_out = 1;
    while (!ended_) {
      step();
      if (stream_.avail_out == 0) fail("is damaged: it holds more than it says");
    }
    if (stream_.avail_in > 0) fail("is damaged: something follows its end");
  }

 private:
  void step() {
    if (ended_) fail("is damaged: it holds less than it says");
    const int result = inflate(&stream_, Z_NO_FLUSH);
    if (result == Z_STREAM_END)
      ended_ = true;
    else if (result == Z_BUF_ERROR && stream_.avail_in == 0)
      fail("is truncated");
    else if (result != Z_OK)
      fail("is damaged: its bytes do not unpack");
  }
  [[noreturn]] void fail(const char* what) const { throw InputError(cat(name_, " ", what)); }

  z_stream stream_{};
  const std::string& name_;
  bool ended_ = false;
};

/// What is wrong with numbers of the header that the columns, or a reader, rely on; empty: nothing.
std::string broken_header(const Replay& r) {
  if (r.agents.empty() || r.agents.size() > kMostAgents) return cat("has ", r.agents.size(), " agents");
  if (r.n_team(0) == 0 || r.n_team(1) == 0) return "has a team without agents";
  for (size_t k = 1; k < r.agents.size(); ++k)
    if (r.agents[k].team < r.agents[k - 1].team) return "has agents of team 1 before those of team 0";
  if (r.maps.empty()) return "has no map";
  if (r.seed.empty() || r.seed.size() > 20 || r.seed.find_first_not_of("0123456789") != std::string::npos)
    return cat("has the seed '", r.seed, "'");
  const auto n = r.n_agents();
  size_t bytes = 0;
  for (size_t k = 0; k < r.episodes.size(); ++k) {
    const ReplayEpisode& e = r.episodes[k];
    const std::string where = cat("episode ", k, " ");
    if (e.map >= static_cast<int>(r.maps.size())) return cat(where, "is on map ", e.map, " of ", r.maps.size());
    if (e.died.size() != r.agents.size() || e.cause.size() != r.agents.size())
      return cat(where, "tells the deaths of ", e.died.size(), " of ", n, " agents");
    for (const int died : e.died)
      if (died > e.steps) return cat(where, "has a death in step ", died, " of ", e.steps);
    for (const ReplayEvent& event : e.events)
      if (event.step > e.steps || event.agent >= n || event.other >= n)
        return cat(where, "has an event of agents ", event.agent, " and ", event.other, " in step ", event.step);
    for (const ReplayWaypoint& w : e.waypoints)
      if (w.to > e.steps || w.from > w.to) return cat(where, "has a waypoint from step ", w.from, " to ", w.to);
    for (const ReplayMind& mind : e.mind)
      if (mind.high < mind.low) return cat(where, "has values from ", mind.low, " to ", mind.high);
    bytes += EpisodeSizes(r, e).all(r, e);
    if (bytes > kMostBytes) return cat("asks for more than ", kMostBytes >> 20, " MiB");
  }
  return "";
}

Replay read_header(const std::string& json, const std::string& name) {
  Errors errors;
  const Document document = parse_yaml_text(json, name, errors);  // JSON is YAML
  errors.throw_if_any();
  if (!document.root.is_map()) throw InputError(cat(name, " is damaged: its header is no JSON object"));
  Replay replay;
  read_fields(document.root, replay, errors);
  errors.throw_if_any();
  if (const std::string wrong = broken_header(replay); !wrong.empty()) throw InputError(cat(name, " ", wrong));
  return replay;
}

void put_columns(const Replay& replay, const ReplayEpisode& e, std::string& out) {
  const EpisodeSizes sizes(replay, e);
  const size_t before = out.size();
  for (const auto& [column, order] : kStates) put_states(e.*column, sizes.states, order, out);
  append(e.action, out);
  append(e.sees, out);
  append(e.fires, out);
  append(e.hears, out);
  for (const ReplayMind& mind : e.mind) {
    append(mind.value, out);
    append(mind.likely, out);
    append(mind.probability, out);
  }
  GIGA_CHECK(out.size() - before == sizes.all(replay, e), "columns of ", out.size() - before, " bytes, ",
             sizes.all(replay, e), " expected");
}

void read_columns(const Replay& replay, Parts parts, ReplayEpisode& e) {
  const EpisodeSizes sizes(replay, e);
  for (const auto& [column, order] : kStates) e.*column = parts.states(sizes.state_numbers, sizes.states, order);
  e.action = parts.bytes(sizes.action_bytes);
  e.sees = parts.bytes(sizes.opponents);
  e.fires = parts.bytes(sizes.opponents);
  e.hears = parts.bytes(sizes.mates);
  for (int team = 0; team < 2; ++team) {
    ReplayMind& mind = e.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_team(team)) * sizes.states;
    mind.value = parts.bytes(sizes.values(mind, rows));
    mind.likely = parts.bytes(sizes.likely(replay, mind, rows));
    mind.probability = parts.bytes(sizes.probabilities(replay, mind, rows));
  }
}

/// What is wrong with actions; empty: nothing.
std::string broken_actions(const Replay& replay, const ReplayEpisode& e) {
  if (replay.actions == ReplayActions::continuous) return "";
  const auto wrong = [](uint8_t action) { return action >= kReplayActions; };
  if (std::any_of(e.action.begin(), e.action.end(), wrong)) return "has an action above 26";
  for (const ReplayMind& mind : e.mind)
    if (std::any_of(mind.likely.begin(), mind.likely.end(), wrong)) return "has a likely action above 26";
  return "";
}

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

float Replay::place_unit() const { return std::max(rules.limit_x, rules.limit_y) / kReplayPlaces; }

uint32_t crc32_of(std::string_view bytes, uint32_t before) {
  return static_cast<uint32_t>(::crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

int64_t action_checksum(const Replay& replay, const ReplayEpisode& episode) {
  const std::string_view actions(reinterpret_cast<const char*>(episode.action.data()), episode.action.size());
  return crc32_of(actions, crc32_of(replay.seed));
}

std::string too_large_to_keep(const Replay& frame, int64_t episodes, int most_steps) {
  ReplayEpisode longest;
  longest.steps = most_steps;
  const size_t most = kMostBytes / EpisodeSizes(frame, longest).all(frame, longest);
  if (static_cast<size_t>(episodes) > most)
    return cat("a replay has room for ", most, " of these games, not for ", episodes);
  return "";
}

std::string encode_replay(const Replay& replay) {
  const std::string wrong = broken_header(replay);
  GIGA_CHECK(wrong.empty(), "the replay ", wrong);
  const std::string json = json_text(json_of(parse_yaml_text(print_yaml(replay, false), "header").root));
  std::string raw;
  for (size_t byte = 0; byte < 4; ++byte) raw += static_cast<char>(json.size() >> (8 * byte) & 255);
  raw += json;
  for (const ReplayEpisode& episode : replay.episodes) put_columns(replay, episode, raw);
  return cat(kMagic, kReplayFormat, '\n') + deflated(raw);
}

Replay decode_replay(std::string_view bytes, const std::string& name) {
  if (bytes.empty()) throw InputError(name + " is empty");
  const size_t end = bytes.substr(0, 40).find('\n');
  if (bytes.substr(0, kMagic.size()) != kMagic || end == std::string_view::npos)
    throw InputError(name + " is no replay: it does not begin as one (gigastep record writes them)");
  const int version = format_of(bytes.substr(kMagic.size(), end - kMagic.size()));
  if (version < 1) throw InputError(name + " is damaged: its first line makes no sense");
  if (version != kReplayFormat)
    throw InputError(cat(name, " has format version ", version,
                         version > kReplayFormat ? ", newer than " : ", older than ", kReplayFormat,
                         ", which this gigastep reads"));
  Inflater stream(bytes.substr(end + 1), name);
  size_t header_size = 0;
  const std::string size_bytes = stream.take(4);
  for (size_t byte = 0; byte < 4; ++byte)
    header_size |= size_t{static_cast<unsigned char>(size_bytes[byte])} << (8 * byte);
  if (header_size > kMostHeader) throw InputError(cat(name, " is damaged: a header of ", header_size, " bytes"));
  Replay replay = read_header(stream.take(header_size), name);
  for (size_t k = 0; k < replay.episodes.size(); ++k) {
    ReplayEpisode& episode = replay.episodes[k];
    const std::string columns = stream.take(EpisodeSizes(replay, episode).all(replay, episode));
    read_columns(replay, Parts(columns), episode);
    if (const std::string wrong = broken_actions(replay, episode); !wrong.empty())
      throw InputError(cat(name, " is damaged: episode ", k, " ", wrong));
    if (action_checksum(replay, episode) != episode.action_check)
      throw InputError(cat(name, " is damaged: the actions of episode ", k, " do not have their checksum"));
  }
  stream.finish();
  return replay;
}

}  // namespace giga
