#include "io/replay_columns.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "core/error.hpp"
#include "io/replay_flight.hpp"

namespace giga {
namespace {

constexpr uint8_t kMostDeath = static_cast<uint8_t>(ReplayDeath::out_of_bounds);
constexpr size_t kMostHits = size_t{1} << 22;

/// 0, -1, 1, -2, 2, ... as 0, 1, 2, 3, 4, ..., and back.
uint16_t folded(int16_t number) { return static_cast<uint16_t>(number < 0 ? -2 * number - 1 : 2 * number); }
int unfolded(int number) { return number & 1 ? -(number + 1) / 2 : number / 2; }

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
  /// See put_folded.
  std::vector<int16_t> folded_numbers(size_t count) {
    const std::string_view part = take(2 * count);
    std::vector<int16_t> column(count);
    for (size_t k = 0; k < count; ++k)
      column[k] = static_cast<int16_t>(
          unfolded(static_cast<unsigned char>(part[k]) | static_cast<unsigned char>(part[count + k]) << 8));
    return column;
  }
  std::vector<float> floats(size_t count) {
    const std::string_view part = take(sizeof(float) * count);
    std::vector<float> column(count);
    std::memcpy(column.data(), part.data(), part.size());
    return column;
  }

 private:
  std::string_view rest_;
};

void append(const std::vector<uint8_t>& bytes, std::string& out) { out.append(bytes.begin(), bytes.end()); }

/// What is wrong with actions; empty: nothing.
std::string broken_actions(const Replay& replay, const ReplayEpisode& e) {
  if (replay.actions == ReplayActions::continuous) return "";
  const auto wrong = [](uint8_t action) { return action >= kReplayActions; };
  if (std::any_of(e.action.begin(), e.action.end(), wrong)) return "has an action above 26";
  for (const ReplayMind& mind : e.mind)
    if (std::any_of(mind.likely.begin(), mind.likely.end(), wrong)) return "has a likely action above 26";
  return "";
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

/// Folded numbers of 16 bits: all low bytes, then all high ones.
void put_folded(const std::vector<int16_t>& numbers, std::string& out) {
  const size_t low = out.size(), count = numbers.size();
  out.resize(low + 2 * count);
  for (size_t k = 0; k < count; ++k) {
    const uint16_t number = folded(numbers[k]);
    out[low + k] = static_cast<char>(number & 255);
    out[low + count + k] = static_cast<char>(number >> 8);
  }
}

/// Rows of numbers less the one before each, modulo 2^16 or 2^8, and back.
template <class Number>
std::vector<Number> differences(const std::vector<Number>& column, size_t states) {
  std::vector<Number> apart(column.size());
  for (size_t k = 0; k < column.size(); ++k)
    apart[k] = static_cast<Number>(column[k] - (k % states ? column[k - 1] : 0));
  return apart;
}
template <class Number>
void add_up(std::vector<Number>& column, size_t states) {
  for (size_t k = 0; k < column.size(); ++k)
    if (k % states) column[k] = static_cast<Number>(column[k] + column[k - 1]);
}

constexpr std::array<std::vector<int16_t> ReplayEpisode::*, ExpectedFlight::kNumbers> kFlight = {
    &ReplayEpisode::x, &ReplayEpisode::y, &ReplayEpisode::z, &ReplayEpisode::heading, &ReplayEpisode::speed};

std::array<float, kReplayControls> controls_of(const Replay& replay, const ReplayEpisode& e, size_t agent,
                                               size_t step) {
  const size_t at = agent * static_cast<size_t>(e.steps) + step;
  if (replay.actions == ReplayActions::discrete) return replay_controls(e.action[at]);
  std::array<float, kReplayControls> controls;
  std::memcpy(controls.data(), e.action.data() + at * sizeof controls, sizeof controls);
  for (float& c : controls) c = c > 1 ? 1.0f : c > -1 ? c : -1.0f;
  return controls;
}

/// Goes through the states of all agents: state(k, expected) tells what number k of each column is, and is told what it
/// is expected to be. Actions and deaths must be there.
template <class State>
void for_states(const Replay& replay, const ReplayEpisode& e, State&& state) {
  const size_t n = replay.agents.size(), states = static_cast<size_t>(e.steps) + 1;
  for (size_t i = 0; i < n; ++i) {
    std::array<float, ExpectedFlight::kNumbers> start;
    for (size_t c = 0; c < start.size(); ++c) start[c] = e.start[c * n + i];
    ExpectedFlight flight(replay, replay.agents[i], start);
    for (size_t s = 0; s < states; ++s) {
      const bool moves = s > 0 && (e.died[i] < 0 || static_cast<int>(s) <= e.died[i]);
      if (moves) flight.step(controls_of(replay, e, i, s - 1));
      const ExpectedFlight::Numbers expected = flight.numbers();
      flight.correct(expected, state(i * states + s, expected));
    }
  }
}

void put_flight(const Replay& replay, const ReplayEpisode& e, std::string& out) {
  std::array<std::vector<int16_t>, kFlight.size()> apart;
  for (std::vector<int16_t>& column : apart) column.resize(e.x.size());
  for_states(replay, e, [&](size_t k, const ExpectedFlight::Numbers& expected) {
    ExpectedFlight::Numbers actual;
    for (size_t c = 0; c < kFlight.size(); ++c) {
      actual[c] = (e.*kFlight[c])[k];
      apart[c][k] = static_cast<int16_t>(actual[c] - expected[c]);
    }
    return actual;
  });
  for (const std::vector<int16_t>& column : apart) put_folded(column, out);
}

void read_flight(const Replay& replay, Parts& parts, ReplayEpisode& e) {
  for (const auto column : kFlight)
    e.*column = parts.folded_numbers(replay.agents.size() * (static_cast<size_t>(e.steps) + 1));
  for_states(replay, e, [&](size_t k, const ExpectedFlight::Numbers& expected) {
    ExpectedFlight::Numbers actual;
    for (size_t c = 0; c < kFlight.size(); ++c)
      actual[c] = (e.*kFlight[c])[k] = static_cast<int16_t>((e.*kFlight[c])[k] + expected[c]);
    return actual;
  });
}

/// [rows, ranks] of [ranks, rows]: what is likely in a state stands together.
std::vector<uint8_t> together(const std::vector<uint8_t>& column, size_t rows) {
  std::vector<uint8_t> to(column.size());
  const size_t ranks = rows ? column.size() / rows : 0;
  for (size_t k = 0; k < column.size(); ++k) to[k % rows * ranks + k / rows] = column[k];
  return to;
}
std::vector<uint8_t> apart(const std::vector<uint8_t>& column, size_t rows) {
  std::vector<uint8_t> to(column.size());
  const size_t ranks = rows ? column.size() / rows : 0;
  for (size_t k = 0; k < column.size(); ++k) to[k] = column[k % rows * ranks + k / rows];
  return to;
}

}  // namespace

void put_columns(const Replay& replay, const ReplayEpisode& e, std::string& out, std::vector<size_t>& ends) {
  const EpisodeSizes sizes(replay, e);
  const size_t before = out.size();
  const auto end = [&] { ends.push_back(out.size()); };
  const auto put = [&](const std::vector<uint8_t>& column) {
    append(column, out);
    end();
  };
  if (replay.is_crowd()) put_deaths(e, out);
  end();
  put(e.action);
  out.append(reinterpret_cast<const char*>(e.start.data()), e.start.size() * sizeof(float));
  end();
  put_flight(replay, e, out);
  put_folded(differences(e.health, sizes.states), out);
  end();
  put(e.sees);
  put(e.fires);
  put(e.hears);
  for (size_t team = 0; team < 2; ++team) {
    const ReplayMind& mind = e.mind[team];
    const size_t rows = static_cast<size_t>(replay.n_minds(static_cast<int>(team))) * sizes.states;
    put(differences(mind.value, sizes.states));
    put(together(mind.likely, rows));
    put(together(mind.probability, rows));
  }
  GIGA_CHECK(out.size() - before == sizes.all(replay, e), "columns of ", out.size() - before, " bytes, ",
             sizes.all(replay, e), " expected");
  if (replay.is_crowd()) put_fire(e.fire, out);
  end();
}

std::string read_columns(const Replay& replay, std::string_view bytes, ReplayEpisode& e) {
  const EpisodeSizes sizes(replay, e);
  Parts parts(bytes);
  if (replay.is_crowd())
    if (std::string wrong = read_deaths(replay, parts, e); !wrong.empty()) return wrong;
  e.action = parts.bytes(sizes.action_bytes);
  e.start = parts.floats(sizes.agents * ExpectedFlight::kNumbers);
  read_flight(replay, parts, e);
  e.health = parts.folded_numbers(sizes.state_numbers);
  add_up(e.health, sizes.states);
  e.sees = parts.bytes(sizes.sees);
  e.fires = parts.bytes(sizes.fires);
  e.hears = parts.bytes(sizes.mates);
  for (int team = 0; team < 2; ++team) {
    ReplayMind& mind = e.mind[static_cast<size_t>(team)];
    const size_t rows = static_cast<size_t>(replay.n_minds(team)) * sizes.states;
    mind.value = parts.bytes(sizes.values(mind, rows));
    add_up(mind.value, sizes.states);
    mind.likely = apart(parts.bytes(sizes.likely(replay, mind, rows)), rows);
    mind.probability = apart(parts.bytes(sizes.probabilities(replay, mind, rows)), rows);
  }
  if (!replay.is_crowd() && !add_hits(ReplayPairs(replay), replay.rules.min_tracking_time, e))
    return cat("has more than ", kMostHits, " hits");
  return broken_actions(replay, e);
}

std::string read_fire(const Replay& replay, size_t count, std::string_view bytes, ReplayEpisode& e) {
  Parts parts(bytes);
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

size_t number_of(std::string_view bytes) {
  size_t number = 0;
  for (size_t byte = 0; byte < bytes.size(); ++byte)
    number |= size_t{static_cast<unsigned char>(bytes[byte])} << 8 * byte;
  return number;
}

bool add_hits(const ReplayPairs& pairs, int min_tracking_time, ReplayEpisode& e) {
  std::vector<ReplayEvent> hits;
  const int states = e.steps + 1, bit_bytes = (states + 7) / 8, n_0 = pairs.n_team(0), n = n_0 + pairs.n_team(1);
  for (int target = 0; target < n; ++target)
    for (int shooter = target < n_0 ? n_0 : 0; shooter < (target < n_0 ? n : n_0); ++shooter) {
      const uint8_t* bits = e.fires.data() + pairs.opponents(target, shooter) * bit_bytes;
      int64_t unbroken = 0;
      for (int s = 0; s < states; ++s) {
        unbroken = bits[s / 8] >> (s & 7) & 1 ? unbroken + 1 : 0;
        if (unbroken != int64_t{min_tracking_time} + 1) continue;
        if (hits.size() == kMostHits) return false;
        hits.push_back({s, ReplayEventKind::hit, shooter, target});
      }
    }
  e.events.insert(e.events.end(), hits.begin(), hits.end());
  std::stable_sort(e.events.begin(), e.events.end(), [](const auto& a, const auto& b) { return a.step < b.step; });
  return true;
}

}  // namespace giga
