// Replays as bytes: a line of text, then one zlib stream: the header as JSON, and the columns of each episode.
#include "io/replay.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/error.hpp"
#include "io/deflate.hpp"
#include "io/json.hpp"

namespace giga {
namespace {

constexpr std::string_view kMagic = "gigastep replay ";
constexpr size_t kMostHeader = size_t{4} << 20, kMostBytes = size_t{1} << 30;
constexpr uint8_t kMostDeath = static_cast<uint8_t>(ReplayDeath::out_of_bounds);

/// How a column of states is kept: each number less what the one before it (order 1), or the two before it (order 2),
/// let expect.
constexpr struct {
  std::vector<int16_t> ReplayEpisode::*column;
  int order;
} kStates[] = {{&ReplayEpisode::x, 2},       {&ReplayEpisode::y, 2},     {&ReplayEpisode::z, 1},
               {&ReplayEpisode::heading, 1}, {&ReplayEpisode::speed, 1}, {&ReplayEpisode::health, 1}};

/// Of an agent of a crowd: when it died, of what, by whom; of a line of fire; and of their number.
constexpr size_t kDeathBytes = 4 + 1 + 4, kFireBytes = 4 * 4, kCountBytes = 4;
/// Lines of fire for which room is kept: one for so many steps of an agent. (In a recorded game of pursuers against
/// circling agents in swarm_1000_vs_1000 one began in 23 steps of living agents.)
constexpr size_t kStepsPerFire = 4;

/// Number of bytes of each part of an episode, from what the header says; without the lines of fire of a crowd.
struct EpisodeSizes {
  size_t states, agents, steps, state_numbers, deaths, action_bytes, sees, fires, mates;

  EpisodeSizes(const Replay& replay, const ReplayEpisode& episode)
      : states(static_cast<size_t>(episode.steps) + 1),
        agents(replay.agents.size()),
        steps(static_cast<size_t>(episode.steps)),
        state_numbers(agents * states),
        deaths(replay.is_crowd() ? agents * kDeathBytes : 0),
        action_bytes(agents * steps *
                     (replay.actions == ReplayActions::discrete ? 1 : sizeof(float) * kReplayControls)),
        sees((replay.is_crowd() ? agents : static_cast<size_t>(ReplayPairs(replay).n_opponents())) * bit_bytes()),
        fires(replay.is_crowd() ? 0 : sees),
        mates(replay.has_hearing() ? static_cast<size_t>(ReplayPairs(replay).n_mates()) * bit_bytes() : 0) {}

  size_t bit_bytes() const { return (states + 7) / 8; }
  size_t mind(const Replay& replay, const ReplayEpisode& episode, int team) const {
    const ReplayMind& mind = episode.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_minds(team)) * states;
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
    return std::size(kStates) * 2 * state_numbers + deaths + action_bytes + sees + fires + mates +
           mind(replay, episode, 0) + mind(replay, episode, 1);
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

/// 32-bit numbers: all lowest bytes, then those above them, and so on.
template <class Number>
void put_numbers(std::string& out, size_t count, const Number& number) {
  const size_t first = out.size();
  out.resize(first + 4 * count);
  for (size_t k = 0; k < count; ++k) {
    const auto value = static_cast<uint32_t>(number(k));
    for (size_t byte = 0; byte < 4; ++byte) out[first + byte * count + k] = static_cast<char>(value >> 8 * byte & 255);
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
  std::vector<uint32_t> numbers(size_t count) {
    const std::string_view part = take(4 * count);
    std::vector<uint32_t> column(count);
    for (size_t k = 0; k < 4 * count; ++k)
      column[k % count] |= uint32_t{static_cast<unsigned char>(part[k])} << 8 * (k / count);
    return column;
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

/// What is wrong with when agents died; empty: nothing.
std::string broken_deaths(const Replay& r, const ReplayEpisode& e) {
  if (e.died.size() != r.agents.size() || e.cause.size() != r.agents.size())
    return cat("tells the deaths of ", e.died.size(), " of ", r.n_agents(), " agents");
  for (const int died : e.died)
    if (died > e.steps) return cat("has a death in step ", died, " of ", e.steps);
  return "";
}

/// What is wrong with numbers of the header that the columns, or a reader, rely on; empty: nothing. Deaths in a crowd
/// are columns.
std::string broken_header(const Replay& r) {
  if (r.agents.empty() || r.agents.size() > kMostReplayAgents) return cat("has ", r.agents.size(), " agents");
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
    if (!r.is_crowd())
      if (const std::string wrong = broken_deaths(r, e); !wrong.empty()) return where + wrong;
    for (const ReplayEvent& event : e.events)
      if (event.step > e.steps || event.agent >= n || event.other >= n)
        return cat(where, "has an event of agents ", event.agent, " and ", event.other, " in step ", event.step);
    for (const ReplayWaypoint& w : e.waypoints)
      if (w.to > e.steps || w.from > w.to) return cat(where, "has a waypoint from step ", w.from, " to ", w.to);
    for (const ReplayMind& mind : e.mind)
      if (mind.high < mind.low) return cat(where, "has values from ", mind.low, " to ", mind.high);
    bytes += EpisodeSizes(r, e).all(r, e) + (r.is_crowd() ? kCountBytes + kFireBytes * e.fire.size() : 0);
    if (bytes > kMostBytes) return cat("asks for more than ", kMostBytes >> 20, " MiB");
  }
  return "";
}

/// The same agent so many times, as crowds have them.
struct AgentGroup : ReplayAgent {
  int count = 1;
};
template <class V>
void visit_fields(V& v, AgentGroup& c) {
  v("count", c.count, "agents in a row", range(1, kMostReplayAgents));
  visit_fields(v, static_cast<ReplayAgent&>(c));
}

/// The header of a crowd: without agents one by one, and without deaths.
struct CrowdHeader {
  Replay replay;
  std::vector<AgentGroup> agents;
};
template <class V>
void visit_fields(V& v, CrowdHeader& c) {
  visit_header(v, c.replay, c.agents);
}

bool same(const ReplayAgent& a, const ReplayAgent& b) {
  return a.team == b.team && a.kind == b.kind && a.sprite == b.sprite && a.max_health == b.max_health &&
         a.range == b.range && a.damage_range == b.damage_range && a.thrust == b.thrust;
}

CrowdHeader crowd_header(const Replay& r) {
  CrowdHeader header{{r.gigastep_version,
                      r.scenario_name,
                      r.scenario,
                      r.seed,
                      r.actions,
                      r.players,
                      r.origins,
                      r.rules,
                      {},
                      r.maps,
                      {}},
                     {}};
  for (const ReplayAgent& agent : r.agents) {
    if (header.agents.empty() || !same(header.agents.back(), agent)) header.agents.push_back({agent, 0});
    ++header.agents.back().count;
  }
  for (const ReplayEpisode& e : r.episodes) {
    ReplayEpisode& head = header.replay.episodes.emplace_back();
    head.map = e.map;
    head.steps = e.steps;
    head.winner = e.winner;
    head.at_time_limit = e.at_time_limit;
    head.returns = e.returns;
    head.score = e.score;
    std::copy_if(e.events.begin(), e.events.end(), std::back_inserter(head.events),
                 [](const ReplayEvent& event) { return event.what != ReplayEventKind::death; });
    head.waypoints = e.waypoints;
    for (size_t team = 0; team < 2; ++team) {
      head.mind[team].low = e.mind[team].low;
      head.mind[team].high = e.mind[team].high;
      head.mind[team].top = e.mind[team].top;
    }
    head.action_check = e.action_check;
    head.state_check = e.state_check;
  }
  return header;
}

/// What is wrong with the header of a crowd; where nothing is, its agents are told one by one then.
std::string spread_out(CrowdHeader& header) {
  size_t count = 0;
  for (const AgentGroup& group : header.agents) count += static_cast<size_t>(group.count);
  if (count <= kMostPaired || count > kMostReplayAgents)
    return cat("has ", count, " agents; in format ", kCrowdFormat, " it would have ", kMostPaired + 1, " to ",
               kMostReplayAgents);
  for (const AgentGroup& group : header.agents)
    header.replay.agents.insert(header.replay.agents.end(), static_cast<size_t>(group.count), group);
  for (const ReplayEpisode& e : header.replay.episodes)
    for (const ReplayEvent& event : e.events)
      if (event.what == ReplayEventKind::death || event.what == ReplayEventKind::hit)
        return "has deaths or hits among its events, which those of a crowd are not";
  return "";
}

Replay read_header(const std::string& json, const std::string& name, int format) {
  Errors errors;
  const Document document = parse_yaml_text(json, name, errors);  // JSON is YAML
  errors.throw_if_any();
  if (!document.root.is_map()) throw InputError(cat(name, " is damaged: its header is no JSON object"));
  CrowdHeader header;
  if (format == kCrowdFormat)
    read_fields(document.root, header, errors);
  else
    read_fields(document.root, header.replay, errors);
  errors.throw_if_any();
  Replay& replay = header.replay;
  std::string wrong = format == kCrowdFormat ? spread_out(header)
                      : replay.is_crowd()    ? cat("has ", replay.n_agents(), " agents")
                                             : "";
  if (wrong.empty()) wrong = broken_header(replay);
  if (!wrong.empty()) throw InputError(cat(name, " ", wrong));
  return std::move(replay);
}

std::string header_text(const Replay& replay) {
  const std::string yaml = replay.is_crowd() ? print_yaml(crowd_header(replay), false) : print_yaml(replay, false);
  return json_text(json_of(parse_yaml_text(yaml, "header").root));
}

/// When the agents of a crowd died, of what, and who shot them down.
void put_deaths(const ReplayEpisode& e, std::string& out) {
  std::vector<int> by(e.died.size(), -1);
  for (const ReplayEvent& event : e.events)
    if (event.what == ReplayEventKind::death && event.agent >= 0) by[static_cast<size_t>(event.agent)] = event.other;
  put_numbers(out, e.died.size(), [&](size_t k) { return e.died[k] + 1; });
  for (const ReplayDeath cause : e.cause) out += static_cast<char>(cause);
  put_numbers(out, by.size(), [&](size_t k) { return by[k] + 1; });
}

/// Returns what is wrong with them; empty: nothing.
std::string read_deaths(const Replay& replay, Parts& parts, ReplayEpisode& e) {
  const size_t n = replay.agents.size();
  const std::vector<uint32_t> died = parts.numbers(n);
  const std::vector<uint8_t> cause = parts.bytes(n);
  const std::vector<uint32_t> by = parts.numbers(n);
  e.died.resize(n);
  e.cause.resize(n);
  std::vector<ReplayEvent> deaths;
  for (size_t k = 0; k < n; ++k) {
    if (died[k] > static_cast<uint32_t>(e.steps) + 1 || by[k] > n || cause[k] > kMostDeath)
      return cat("has a death of agent ", k, " in step ", died[k], " of ", e.steps, " by agent ", by[k]);
    e.died[k] = static_cast<int>(died[k]) - 1;
    e.cause[k] = static_cast<ReplayDeath>(cause[k]);
    if (died[k] > 0)
      deaths.push_back({e.died[k], ReplayEventKind::death, static_cast<int>(k), static_cast<int>(by[k]) - 1});
  }
  e.events.insert(e.events.end(), deaths.begin(), deaths.end());
  std::stable_sort(e.events.begin(), e.events.end(), [](const auto& a, const auto& b) { return a.step < b.step; });
  return "";
}

void put_fire(const std::vector<ReplayFire>& fire, std::string& out) {
  put_numbers(out, 1, [&](size_t) { return fire.size(); });
  put_numbers(out, fire.size(), [&](size_t k) { return fire[k].from - (k ? fire[k - 1].from : 0); });
  put_numbers(out, fire.size(), [&](size_t k) { return fire[k].to - fire[k].from; });
  put_numbers(out, fire.size(), [&](size_t k) { return fire[k].target; });
  put_numbers(out, fire.size(), [&](size_t k) { return fire[k].shooter; });
}

/// Returns what is wrong with it; empty: nothing.
std::string read_fire(const Replay& replay, size_t count, Parts parts, ReplayEpisode& e) {
  const std::vector<uint32_t> wait = parts.numbers(count), more = parts.numbers(count), target = parts.numbers(count),
                              shooter = parts.numbers(count);
  const auto n = static_cast<uint32_t>(replay.n_agents()), first_of_1 = static_cast<uint32_t>(replay.n_team(0));
  const auto last = static_cast<uint64_t>(e.steps);
  uint64_t from = 0;
  for (size_t k = 0; k < count; ++k) {
    from += wait[k];
    if (from + more[k] > last || target[k] >= n || shooter[k] >= n ||
        (target[k] < first_of_1) == (shooter[k] < first_of_1))
      return cat("has fire of agent ", shooter[k], " at agent ", target[k], " from step ", from, " of ", last);
    const ReplayFire now{static_cast<int>(from), static_cast<int>(from + more[k]), static_cast<int>(target[k]),
                         static_cast<int>(shooter[k])};
    const auto order = [](const ReplayFire& f) { return std::array{f.from, f.target, f.shooter}; };
    if (k > 0 && order(now) <= order(e.fire.back())) return cat("has lines of fire out of their order in step ", from);
    e.fire.push_back(now);
  }
  return "";
}

void put_columns(const Replay& replay, const ReplayEpisode& e, std::string& out) {
  const EpisodeSizes sizes(replay, e);
  const size_t before = out.size();
  for (const auto& [column, order] : kStates) put_states(e.*column, sizes.states, order, out);
  if (replay.is_crowd()) put_deaths(e, out);
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
  if (replay.is_crowd()) put_fire(e.fire, out);
}

/// Returns what is wrong with them; empty: nothing.
std::string read_columns(const Replay& replay, Parts parts, ReplayEpisode& e) {
  const EpisodeSizes sizes(replay, e);
  for (const auto& [column, order] : kStates) e.*column = parts.states(sizes.state_numbers, sizes.states, order);
  if (replay.is_crowd())
    if (std::string wrong = read_deaths(replay, parts, e); !wrong.empty()) return wrong;
  e.action = parts.bytes(sizes.action_bytes);
  e.sees = parts.bytes(sizes.sees);
  e.fires = parts.bytes(sizes.fires);
  e.hears = parts.bytes(sizes.mates);
  for (int team = 0; team < 2; ++team) {
    ReplayMind& mind = e.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_minds(team)) * sizes.states;
    mind.value = parts.bytes(sizes.values(mind, rows));
    mind.likely = parts.bytes(sizes.likely(replay, mind, rows));
    mind.probability = parts.bytes(sizes.probabilities(replay, mind, rows));
  }
  return "";
}

size_t number_of(std::string_view bytes) {
  size_t number = 0;
  for (size_t byte = 0; byte < bytes.size(); ++byte)
    number |= size_t{static_cast<unsigned char>(bytes[byte])} << 8 * byte;
  return number;
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

float place_unit(float longer_side, int n_agents) {
  return n_agents > kMostPaired ? std::max(longer_side / kCrowdPlaces, kCrowdPlace) : longer_side / kReplayPlaces;
}

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
  const size_t most = kMostBytes / (sizes.all(frame, longest) + fire);
  if (static_cast<size_t>(episodes) > most)
    return cat("a replay has room for ", most, " of these games, not for ", episodes);
  return "";
}

std::string encode_replay(const Replay& replay) {
  const std::string wrong = broken_header(replay);
  GIGA_CHECK(wrong.empty(), "the replay ", wrong);
  const std::string json = header_text(replay);
  std::string raw;
  for (size_t byte = 0; byte < 4; ++byte) raw += static_cast<char>(json.size() >> (8 * byte) & 255);
  raw += json;
  for (const ReplayEpisode& episode : replay.episodes) put_columns(replay, episode, raw);
  return cat(kMagic, replay.is_crowd() ? kCrowdFormat : kReplayFormat, '\n') + deflated(raw);
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
  Inflater stream(bytes.substr(end + 1), name);
  const size_t header_size = number_of(stream.take(4));
  if (header_size > kMostHeader) throw InputError(cat(name, " is damaged: a header of ", header_size, " bytes"));
  Replay replay = read_header(stream.take(header_size), name, version);
  size_t fire_bytes = 0;
  for (size_t k = 0; k < replay.episodes.size(); ++k) {
    ReplayEpisode& episode = replay.episodes[k];
    const std::string columns = stream.take(EpisodeSizes(replay, episode).all(replay, episode));
    std::string wrong = read_columns(replay, Parts(columns), episode);
    if (wrong.empty()) wrong = broken_actions(replay, episode);
    if (wrong.empty() && replay.is_crowd()) {
      const size_t count = number_of(stream.take(kCountBytes));
      fire_bytes += kFireBytes * count;
      if (fire_bytes > kMostBytes) throw InputError(cat(name, " asks for more than ", kMostBytes >> 20, " MiB"));
      const std::string lines = stream.take(kFireBytes * count);
      wrong = read_fire(replay, count, Parts(lines), episode);
    }
    if (!wrong.empty()) throw InputError(cat(name, " is damaged: episode ", k, " ", wrong));
    if (action_checksum(replay, episode) != episode.action_check)
      throw InputError(cat(name, " is damaged: the actions of episode ", k, " do not have their checksum"));
  }
  stream.finish();
  return replay;
}

}  // namespace giga
