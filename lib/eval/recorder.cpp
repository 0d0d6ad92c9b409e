#include "eval/recorder.hpp"

#include <torch/types.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <tuple>
#include <utility>

#include "core/error.hpp"
#include "learn/players/value_function.hpp"
#include "math/distributions.hpp"
#include "policy/policy.hpp"
#include "rollout/tensors.hpp"
#include "sim/grid.hpp"
#include "sim/image_rows.hpp"
#include "sim/row_layout.hpp"
#include "sim/state_observation.hpp"

namespace giga {
namespace {

int16_t whole_multiple(float value, float unit) {
  const float count = std::round(value / unit);
  return static_cast<int16_t>(std::clamp(count, -32768.0f, 32767.0f));  // a NaN cannot come from a simulator
}

/// Every 64th of 65,536 headings of a turn, going round.
int16_t heading_number(float heading) {
  constexpr double kPerRadian = 1024 / (2 * std::numbers::pi);
  const auto at = static_cast<int64_t>(std::lround(static_cast<double>(heading) * kPerRadian));
  return static_cast<int16_t>(static_cast<uint16_t>(at * 64));
}

/// [rows, columns] of [columns, rows].
template <class T>
std::vector<T> transposed(const std::vector<T>& from, size_t columns, size_t rows) {
  std::vector<T> to(from.size());
  for (size_t c = 0; c < columns; ++c)
    for (size_t r = 0; r < rows; ++r) to[r * columns + c] = from[c * rows + r];
  return to;
}

constexpr uint32_t kNoAgent = 0xFFFFFFFF;  // of the rows of an observation

/// Also of worlds of any number of agents: those of team 0 come first.
int team_of(const SimParams& p, int agent) { return agent < p.n_team[0] ? 0 : 1; }
bool is_crowd(const SimParams& p) { return p.n_agents > kMostPaired; }
/// Agents of a team of which it is kept what their networks say.
int n_minds(const SimParams& p, int team) {
  return is_crowd(p) ? std::min(p.n_team[team], kMostMinds) : p.n_team[team];
}

bool bit(const uint32_t* words, int k) { return words[k / 32] >> (k & 31) & 1u; }

ReplayDeath death_of(Death death) { return static_cast<ReplayDeath>(death); }
static_assert(static_cast<int>(ReplayDeath::out_of_bounds) == static_cast<int>(Death::out_of_bounds));

/// The likeliest actions of rows of logits, and their probabilities in units of 1 / kReplayShares.
void note_likely(const float* logits, std::vector<uint8_t>& likely, std::vector<uint8_t>& probability) {
  std::array<std::pair<float, uint8_t>, kNDiscreteActions> order;
  float sum = 0;
  const float top = *std::max_element(logits, logits + kNDiscreteActions);
  for (uint8_t k = 0; k < kNDiscreteActions; ++k) {
    order[k] = {-std::exp(logits[k] - top), k};
    sum -= order[k].first;
  }
  std::partial_sort(order.begin(), order.begin() + kLikelyActions, order.end());
  for (size_t k = 0; k < kLikelyActions; ++k) {
    likely.push_back(order[k].second);
    probability.push_back(static_cast<uint8_t>(std::lround(-order[k].first / sum * kReplayShares)));
  }
}

/// What the dead do and their networks say has no effect, and costs as much room as what the living do.
void forget_the_dead(const SimParams& p, ReplayEpisode& e) {
  const auto states = static_cast<size_t>(e.steps) + 1;
  for (size_t i = 0; i < e.died.size(); ++i) {
    if (e.died[i] < 0) continue;
    const size_t died = static_cast<size_t>(e.died[i]), steps = states - 1;
    const size_t size = p.actions == ActionKind::discrete ? 1 : kActionSize * sizeof(float);
    const uint8_t nothing = p.actions == ActionKind::discrete ? 13 : 0;
    const auto action = e.action.begin() + static_cast<std::ptrdiff_t>(i * steps * size);
    std::fill(action + static_cast<std::ptrdiff_t>(died * size), action + static_cast<std::ptrdiff_t>(steps * size),
              nothing);
    const int team = team_of(p, static_cast<int>(i));
    const auto rows = static_cast<size_t>(n_minds(p, team)), row = i - (team ? static_cast<size_t>(p.n_team[0]) : 0);
    if (row >= rows) continue;
    ReplayMind& mind = e.mind[static_cast<size_t>(team)];
    for (std::vector<uint8_t>* column : {&mind.value, &mind.likely, &mind.probability})
      for (size_t first = row * states; first < column->size(); first += rows * states)
        std::fill(column->begin() + static_cast<std::ptrdiff_t>(first + died),
                  column->begin() + static_cast<std::ptrdiff_t>(first + states), uint8_t{0});
  }
}

}  // namespace

/// Bits of pairs, or of agents, over states, of which `most` may come.
class Recorder::PairBits {
 public:
  PairBits() = default;
  PairBits(int64_t pairs, int64_t most) : row_((most + 7) / 8), bytes_(static_cast<size_t>(pairs * row_)) {}

  void set(int64_t pair, int64_t state) {
    bytes_[static_cast<size_t>(pair * row_ + state / 8)] |= static_cast<uint8_t>(1u << (state & 7));
  }
  /// [pairs, states] with rows of whole bytes.
  std::vector<uint8_t> cut(int64_t states) const {
    const int64_t row = (states + 7) / 8;
    std::vector<uint8_t> out;
    for (size_t at = 0; at < bytes_.size(); at += static_cast<size_t>(row_))
      out.insert(out.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                 bytes_.begin() + static_cast<std::ptrdiff_t>(at) + row);
    return out;
  }

 private:
  int64_t row_ = 0;
  std::vector<uint8_t> bytes_;
};

/// What a crowd keeps of pairs, of one world: PairLists and the length of a list of fire.
struct Recorder::Lists {
  const uint32_t *fire, *neighbors;
  int shooters;
};

/// What is known of one world so far. Histories are [states, agents] until the end.
struct Recorder::World {
  World(const SimParams& p, int64_t most_states)
      : pairs(p.n_team[0], p.n_team[1]),
        died(static_cast<size_t>(p.n_agents), -1),
        cause(died.size()),
        sees(is_crowd(p) ? p.n_agents : pairs.n_opponents(), most_states),
        fires(is_crowd(p) ? 0 : pairs.n_opponents(), most_states),
        hears(p.n_agents <= kMostListeners ? pairs.n_mates() : 0, most_states),
        burning(is_crowd(p) ? died.size() : 0) {}

  void note(const SimSpec& spec, const WorldView& w, const Lists& lists, float place_unit);
  void note_pairs(const SimParams& p, const WorldView& w);
  void note_lists(const SimParams& p, const WorldView& w, const Lists& lists);
  void note_fire(int target, const uint32_t* entries, int most);
  void note_death(const WorldView& w, int agent, int shooter);
  void note_scores(const SimParams& p, const WorldView& w);
  void note_waypoints(const SimParams& p, const WorldView& w);
  void event(ReplayEventKind what, int agent = -1, int other = -1) { events.push_back({states, what, agent, other}); }

  ReplayPairs pairs;
  bool over = false;
  int states = 0, map = 0;
  uint32_t check = 0;
  std::vector<float> start;  // [5, N]
  std::vector<int16_t> x, y, z, heading, speed, health;
  std::vector<uint8_t> action;  // [T, N, bytes of one]
  std::vector<int> died;
  std::vector<ReplayDeath> cause;
  std::vector<ReplayEvent> events;
  std::vector<ReplayWaypoint> waypoints;
  PairBits sees, fires, hears;
  std::vector<std::vector<ReplayFire>> burning;  // of a crowd, by target: fire that goes on, by shooter
  std::vector<ReplayFire> fire;                  // and that which has ended
  bool contact[kNTeams] = {};
  float score[kNTeams] = {}, returns[kNTeams] = {};
  bool at_time_limit = false;
  ReplayEnd winner = ReplayEnd::tie;
  std::vector<float> values[kNTeams];                          // [states, n]
  std::vector<uint8_t> likely[kNTeams], probability[kNTeams];  // [states, n, K]
};

/// One more state.
void Recorder::World::note(const SimSpec& spec, const WorldView& w, const Lists& lists, float place_unit) {
  const SimParams& p = spec.params;
  const int n = p.n_agents;
  const auto add_check = [&](const auto* field) {
    check = crc32_of({reinterpret_cast<const char*>(field), static_cast<size_t>(n) * sizeof *field}, check);
  };
  for (const float* field : {w.x, w.y, w.z, w.v, w.heading, w.health}) add_check(field);
  add_check(w.alive);
  map = *w.map;
  if (states == 0)
    for (const float* field : {w.x, w.y, w.z, w.heading, w.v}) start.insert(start.end(), field, field + n);
  for (int i = 0; i < n; ++i) {
    x.push_back(whole_multiple(w.x[i], place_unit));
    y.push_back(whole_multiple(w.y[i], place_unit));
    z.push_back(whole_multiple(w.z[i], kReplayAltitude));
    heading.push_back(heading_number(w.heading[i]));
    speed.push_back(whole_multiple(w.v[i], kReplaySpeed));
    health.push_back(whole_multiple(w.health[i], kReplayHealth));
  }
  over = *w.phase == Phase::waits;
  const auto stat = [&](EpisodeStat s) { return w.stats[static_cast<int>(s)]; };
  if (is_crowd(p)) {
    note_lists(p, w, lists);
  } else {
    note_pairs(p, w);
    note_scores(p, w);
    note_waypoints(p, w);
  }
  if (over) {
    at_time_limit = stat(EpisodeStat::truncated) > 0;
    winner = stat(EpisodeStat::wins_0) > 0   ? ReplayEnd::team_0
             : stat(EpisodeStat::wins_1) > 0 ? ReplayEnd::team_1
                                             : ReplayEnd::tie;
  }
  ++states;
}

void Recorder::World::note_death(const WorldView& w, int agent, int shooter) {
  const auto k = static_cast<size_t>(agent);
  if (w.alive[agent] || died[k] >= 0) return;
  died[k] = states;
  cause[k] = death_of(w.death[agent]);
  event(ReplayEventKind::death, agent, w.death[agent] == Death::damage ? shooter : -1);
}

void Recorder::World::note_pairs(const SimParams& p, const WorldView& w) {
  const int n = p.n_agents, words = words_for(n);
  for (int a = 0; a < n; ++a) {
    int shooter = -1;
    for (int b = 0; b < n; ++b) {
      if (team_of(p, a) == team_of(p, b)) {
        // What an agent sees of its own team is whom it hears (rules 6). The dead say nothing of interest.
        if (a != b && n <= kMostListeners && w.alive[a] && bit(w.seen + int64_t{a} * words, b))
          hears.set(pairs.mates(a, b), states);
        continue;
      }
      const int tracked = w.tracked[int64_t{a} * n + b];
      if (tracked > 0) fires.set(pairs.opponents(a, b), states);
      if (tracked > p.min_tracking_time) shooter = b;
      if (!bit(w.detected + int64_t{a} * words, b)) continue;
      sees.set(pairs.opponents(a, b), states);
      if (!std::exchange(contact[team_of(p, b)], true)) event(ReplayEventKind::contact, b, a);
    }
    note_death(w, a, shooter);
  }
}

/// Whom an agent of a crowd sees are the agents of its rows (rules 17.3); the dead listen on, which does not count.
void Recorder::World::note_lists(const SimParams& p, const WorldView& w, const Lists& lists) {
  for (int b = 0; b < p.n_agents; ++b) {
    const uint32_t* rows = lists.neighbors + int64_t{b} * p.n_neighbors;
    for (int k = 0; w.alive[b] && k < p.n_neighbors; ++k) {
      const auto a = static_cast<int>(rows[k]);
      if (rows[k] == kNoAgent || team_of(p, a) == team_of(p, b) || !w.alive[a]) continue;
      sees.set(a, states);
      if (!std::exchange(contact[team_of(p, b)], true)) event(ReplayEventKind::contact, b, a);
    }
  }
  note_scores(p, w);
  note_waypoints(p, w);
  for (int a = 0; a < p.n_agents; ++a) {
    const uint32_t* entries = lists.fire + int64_t{a} * lists.shooters;
    int shooter = -1;
    for (int k = 0; k < lists.shooters && entries[k] != 0; ++k)
      if (count_of(entries[k]) > p.min_tracking_time) shooter = shooter_of(entries[k]);
    note_fire(a, entries, lists.shooters);
    note_death(w, a, shooter);
  }
}

/// Both lists are ordered by shooter.
void Recorder::World::note_fire(int target, const uint32_t* entries, int most) {
  std::vector<ReplayFire>& before = burning[static_cast<size_t>(target)];
  std::vector<ReplayFire> now;
  auto old = before.begin();
  const auto end_below = [&](int shooter) {
    for (; old != before.end() && old->shooter < shooter; ++old) fire.push_back(*old);
  };
  for (int k = 0; k < most && entries[k] != 0; ++k) {
    const int shooter = shooter_of(entries[k]);
    end_below(shooter);
    const bool goes_on = old != before.end() && old->shooter == shooter;
    now.push_back(goes_on ? *old++ : ReplayFire{states, states, target, shooter});
    now.back().to = states;
  }
  fire.insert(fire.end(), old, before.end());
  before = std::move(now);
}

void Recorder::World::note_scores(const SimParams& p, const WorldView& w) {
  const auto stat = [&](EpisodeStat s) { return w.stats[static_cast<int>(s)]; };
  for (int team = 0; team < kNTeams; ++team) {
    const float now = over ? stat(of_team(EpisodeStat::score_0, team)) : w.score[team];
    returns[team] = stat(of_team(EpisodeStat::return_0, team));
    for (int i = 0; now > score[team] && !waypoints.empty() && i < p.n_agents; ++i) {
      const ReplayWaypoint& last = waypoints.back();
      if (team_of(p, i) != team || w.x[i] < last.x1 || w.x[i] > last.x2 || w.y[i] < last.y1 || w.y[i] > last.y2)
        continue;
      event(ReplayEventKind::collected, i);
      break;
    }
    score[team] = now;
  }
}

void Recorder::World::note_waypoints(const SimParams& p, const WorldView& w) {
  if (!p.waypoints || !(*w.waypoint_time > 0)) return;
  const float* at = w.waypoint;
  const bool same = !waypoints.empty() && waypoints.back().to == states - 1 && waypoints.back().x1 == at[0] &&
                    waypoints.back().y1 == at[1];
  if (!same) {
    waypoints.push_back({states, states, at[0], at[1], at[2], at[3]});
    event(ReplayEventKind::waypoint);
  }
  waypoints.back().to = states;
}

/// What the networks know of the games so far: [W n, S] by team.
struct Recorder::Remembered {
  std::array<NetworkState, kNTeams> policies, critics;
};

/// States of which the networks are not asked yet: a GPU takes as long for one state as for many. Those that remember
/// are asked of each state at once.
struct Recorder::Waiting {
  static constexpr int64_t kMost = 64, kMostBytes = int64_t{1} << 26;
  int64_t most = 1, count = 0;  // states
  Device device;
  at::Tensor numbers[kNTeams];  // [most, W n, D] that agents see, where a network reads them
  at::Tensor images[kNTeams];   // [most, W n, R R 3] likewise
  at::Tensor alive;             // [most, W, N] bytes
  at::Tensor truth;             // [most, W, G] where a critic reads it
  std::vector<int> states;      // [count, W] that a world had by then, this one included
};

Recorder::Recorder(const SimSpec& spec, const Minds& minds)
    : spec_(spec.with_time_limit()),
      minds_(minds),
      remembered_(std::make_unique<Remembered>()),
      waiting_(std::make_unique<Waiting>()) {
  GIGA_CHECK(spec_.params.team_after_team, "agents of team 1 before those of team 0");
}

Recorder::~Recorder() = default;

void Recorder::before_step(int64_t, GameStep& step) {
  bool needs_state = false;
  for (int team = 0; team < kNTeams; ++team) {
    const Mind& mind = minds_[static_cast<size_t>(team)];
    if (mind.policy) step.rows[team].wanted |= mind.policy->reads();
    if (mind.values) step.rows[team].wanted |= mind.values->reads();
    needs_state = needs_state || (mind.values && mind.values->needs_state());
  }
  if (!needs_state) return;
  const Simulator& sim = *step.sim;
  const auto size = static_cast<size_t>(sim.n_worlds()) * static_cast<size_t>(spec_.state_size());
  if (true_state_.size() == 0) true_state_ = Buffer<float>(sim.memory(), size);
  void*& rows = step.io.world[Observation::state].rows;
  if (!rows) rows = true_state_.data();
}

void Recorder::after_step(int64_t t, const GameStep& step) {
  const Simulator& sim = *step.sim;
  const auto over = [this] {
    return std::all_of(worlds_.begin(), worlds_.end(), [](const World& w) { return w.over; });
  };
  if (t < 0) {
    GIGA_CHECK(sim.options().on_done == OnDone::freeze && sim.options().episodes == 1, "this is no match");
    const int64_t most = spec_.params.max_episode_length + 1;
    worlds_.assign(static_cast<size_t>(sim.n_worlds()), World(spec_.params, most));
    make_room(step);
  } else if (over()) {
    return;
  } else {
    note_actions(step);
  }
  read_state(sim);
  const float unit = place_unit(std::max(spec_.params.limit_x, spec_.params.limit_y), spec_.params.n_agents);
  for (size_t w = 0; w < worlds_.size(); ++w)
    if (!worlds_[w].over) worlds_[w].note(spec_, view_of(w), lists_of(sim, w), unit);
  put_off(step);
  if (over() || waiting_->count == waiting_->most) ask_minds();
}

/// One copy of all fields.
void Recorder::read_state(const Simulator& sim) {
  bytes_ = sim.state().save();
  const StateView& there = sim.state().view();
  const auto* first = reinterpret_cast<const uint8_t*>(there.x);  // the first of the field list
  const auto copied = [&](const auto* field) {
    const auto* at = bytes_.data() + (reinterpret_cast<const uint8_t*>(field) - first);
    return reinterpret_cast<decltype(field)>(at);
  };
  for_each_field([&](auto, auto member) {
    auto*& field = state_.*member;
    field = there.*member ? const_cast<std::remove_reference_t<decltype(field)>>(copied(there.*member)) : nullptr;
  });
  const PairLists& lists = sim.state().lists();
  if (lists.fire) lists_ = {const_cast<uint32_t*>(copied(lists.fire)), const_cast<uint32_t*>(copied(lists.neighbors))};
}

WorldView Recorder::view_of(size_t world) const {
  WorldView w{};
  for_each_field([&](auto field, auto member) {
    if (state_.*member) w.*member = state_.*member + static_cast<int64_t>(world) * field.count(spec_.params.n_agents);
  });
  return w;
}

Recorder::Lists Recorder::lists_of(const Simulator& sim, size_t world) const {
  const StateShape& shape = sim.state().shape();
  if (!shape.lists()) return {nullptr, nullptr, 0};
  const int64_t first = static_cast<int64_t>(world) * shape.n_agents;
  return {lists_.fire + first * shape.shooters, lists_.neighbors + first * shape.rows, shape.shooters};
}

void Recorder::note_actions(const GameStep& step) {
  const bool discrete = spec_.params.actions == ActionKind::discrete;
  const size_t size = discrete ? sizeof(int32_t) : kActionSize * sizeof(float);
  for (int team = 0; team < kNTeams; ++team) {
    const size_t row = static_cast<size_t>(spec_.params.n_team[team]) * size;
    std::vector<uint8_t> bytes(worlds_.size() * row);
    step.sim->memory().to_host(bytes.data(), step.team[team].action, bytes.size());
    for (size_t w = 0; w < worlds_.size(); ++w) {
      if (worlds_[w].over) continue;
      const uint8_t* from = bytes.data() + w * row;
      std::vector<uint8_t>& action = worlds_[w].action;
      for (size_t at = 0; at < row; at += size) {
        if (!discrete) {
          action.insert(action.end(), from + at, from + at + size);
          continue;
        }
        int32_t index = 0;
        std::memcpy(&index, from + at, sizeof index);
        action.push_back(static_cast<uint8_t>(std::clamp(index, 0, kNDiscreteActions - 1)));  // as rules 3.2 clamp
      }
    }
  }
}

/// For what the networks read of as many states as may wait.
void Recorder::make_room(const GameStep& step) {
  const Simulator& sim = *step.sim;
  Waiting& to = *waiting_;
  to.device = sim.device();
  const auto w = static_cast<int64_t>(worlds_.size());
  const auto asks = [](const Mind& mind) { return mind.policy || mind.values; };
  const auto remembers = [](const Mind& mind) {
    return (mind.policy && mind.policy->state_size() > 0) || (mind.values && mind.values->state_size() > 0);
  };
  const bool at_once = std::any_of(minds_.begin(), minds_.end(), remembers);
  if (std::none_of(minds_.begin(), minds_.end(), asks)) return;

  int64_t bytes = 0;  // of a state
  std::vector<std::pair<at::Tensor*, at::Tensor>> rooms;
  const auto room = [&](at::Tensor& tensor, at::IntArrayRef sizes, at::ScalarType type) {
    const at::Tensor one = at::empty(sizes, at::TensorOptions().dtype(type).device(torch_device(to.device)));
    bytes += static_cast<int64_t>(one.nbytes());
    rooms.emplace_back(&tensor, one);
  };
  for (int team = 0; team < kNTeams; ++team) {
    const Mind& mind = minds_[static_cast<size_t>(team)];
    if (!asks(mind)) continue;
    const int64_t rows = w * spec_.params.n_team[team];
    const auto reads = [&](bool image) {
      return (mind.policy && mind.policy->reads_image() == image) ||
             (mind.values && mind.values->reads_image() == image);
    };
    if (reads(false) && step.rows[team].obs)
      room(to.numbers[team], {rows, observation_rows(spec_).stride()}, at::kFloat);
    if (reads(true)) room(to.images[team], {rows, image_bytes(spec_.params.resolution)}, at::kByte);
  }
  room(to.alive, {w, spec_.params.n_agents}, at::kByte);
  if (step.io.world[Observation::state].rows) room(to.truth, {w, spec_.state_size()}, at::kFloat);
  to.most = at_once ? 1 : std::clamp<int64_t>(Waiting::kMostBytes / bytes, 1, Waiting::kMost);
  for (auto& [tensor, one] : rooms) {
    std::vector<int64_t> sizes = one.sizes().vec();
    sizes.insert(sizes.begin(), to.most);
    *tensor = at::empty(sizes, one.options());
  }
}

/// Keeps what the networks read of the states that were noted last.
void Recorder::put_off(const GameStep& step) {
  Waiting& to = *waiting_;
  if (!to.alive.defined()) return;  // nobody asks
  const auto keep = [&](const at::Tensor& room, const auto* from) {
    if (!room.defined()) return;
    const at::Tensor slot = room[to.count];
    slot.copy_(wrap(from, slot.sizes(), to.device));
  };
  for (int team = 0; team < kNTeams; ++team) {
    keep(to.numbers[team], step.rows[team].obs);
    keep(to.images[team], static_cast<const uint8_t*>(step.io.team[team].obs[Observation::image].rows));
  }
  keep(to.alive, step.sim->state().view().alive);
  keep(to.truth, static_cast<const float*>(step.io.world[Observation::state].rows));
  for (const World& world : worlds_) to.states.push_back(world.states);
  ++to.count;
}

/// What the networks make of the states that wait.
void Recorder::ask_minds() {
  at::NoGradGuard no_grad;
  Waiting& from = *waiting_;
  if (from.count == 0) return;
  const auto w = static_cast<int64_t>(worlds_.size()), count = from.count;
  // Rows of all states: [count, R, ...] -> [count R, ...]; undefined where there are none.
  const auto all = [&](const at::Tensor& room) {
    return room.defined() ? room.narrow(0, 0, count).flatten(0, 1) : at::Tensor();
  };
  for (int team = 0; team < kNTeams; ++team) {
    const Mind& mind = minds_[static_cast<size_t>(team)];
    if (!mind.policy && !mind.values) continue;
    const int64_t n = spec_.params.n_team[team];
    at::Tensor head, value;
    const auto seen = [&](bool image) { return all(image ? from.images[team] : from.numbers[team]); };
    if (mind.policy) {
      head = mind.policy->forward(seen(mind.policy->reads_image()), remembered_->policies[static_cast<size_t>(team)]);
      if (spec_.params.actions == ActionKind::continuous) head = head.tanh();
      head = head.to(at::kCPU).contiguous();
    }
    if (mind.values) {
      const int64_t first = team == 0 ? 0 : spec_.params.n_team[0];
      const at::Tensor alive = all(from.alive).narrow(1, first, n);
      const at::Tensor state = mind.values->needs_state() ? all(from.truth) : at::Tensor();
      at::Tensor obs = seen(mind.values->reads_image());
      if (obs.defined()) obs = obs.view({count * w, n, -1});
      value = mind.values->forward(obs, alive, state, remembered_->critics[static_cast<size_t>(team)])
                  .to(at::kCPU)
                  .contiguous();
    }
    const int64_t kept = n_minds(spec_.params, team);
    for (int64_t at = 0; at < count * w; ++at) {
      World& world = worlds_[static_cast<size_t>(at % w)];
      // One row for each state, that of the end included.
      const auto rows_so_far = static_cast<size_t>(from.states[static_cast<size_t>(at)] * kept);
      if (head.defined() && world.likely[team].size() < rows_so_far * kLikelyActions) {
        const float* row = head.const_data_ptr<float>() + at * n * head.size(1);
        for (int64_t i = 0; i < kept; ++i, row += head.size(1)) {
          if (spec_.params.actions == ActionKind::discrete) {
            note_likely(row, world.likely[team], world.probability[team]);
            continue;
          }
          for (int c = 0; c < kActionSize; ++c)
            world.likely[team].push_back(static_cast<uint8_t>(std::lround(128 + 127 * row[c])));
        }
      }
      if (value.defined() && world.values[team].size() < rows_so_far) {
        const float* row = value.const_data_ptr<float>() + at * n;
        world.values[team].insert(world.values[team].end(), row, row + kept);
      }
    }
  }
  from.count = 0;
  from.states.clear();
}

std::vector<ReplayEpisode> Recorder::episodes(const std::string& seed) const {
  std::vector<ReplayEpisode> all;
  const auto n = static_cast<size_t>(spec_.params.n_agents);
  const bool discrete = spec_.params.actions == ActionKind::discrete;
  for (const World& w : worlds_) {
    GIGA_CHECK(w.over && w.states > 1, "an episode that has not ended");
    const auto states = static_cast<size_t>(w.states);
    ReplayEpisode& e = all.emplace_back();
    e.map = w.map;
    e.steps = w.states - 1;
    e.winner = w.winner;
    e.at_time_limit = w.at_time_limit;
    e.returns = {w.returns[0], w.returns[1]};
    e.score = {w.score[0], w.score[1]};
    e.died = w.died;
    e.cause = w.cause;
    e.events = w.events;
    e.waypoints = w.waypoints;
    e.state_check = w.check;
    e.start = w.start;
    e.x = transposed(w.x, states, n);
    e.y = transposed(w.y, states, n);
    e.z = transposed(w.z, states, n);
    e.heading = transposed(w.heading, states, n);
    e.speed = transposed(w.speed, states, n);
    e.health = transposed(w.health, states, n);
    if (discrete) {
      e.action = transposed(w.action, states - 1, n);
    } else {
      constexpr size_t kSize = kActionSize * sizeof(float);
      e.action.resize(w.action.size());
      for (size_t t = 0; t + 1 < states; ++t)
        for (size_t i = 0; i < n; ++i)
          std::memcpy(e.action.data() + (i * (states - 1) + t) * kSize, w.action.data() + (t * n + i) * kSize, kSize);
    }
    e.sees = w.sees.cut(w.states);
    e.fires = w.fires.cut(w.states);
    e.hears = w.hears.cut(w.states);
    e.fire = w.fire;
    for (const std::vector<ReplayFire>& on : w.burning) e.fire.insert(e.fire.end(), on.begin(), on.end());
    std::sort(e.fire.begin(), e.fire.end(), [](const ReplayFire& a, const ReplayFire& b) {
      return std::tie(a.from, a.target, a.shooter) < std::tie(b.from, b.target, b.shooter);
    });
    for (int team = 0; team < kNTeams; ++team) {
      ReplayMind& mind = e.mind[static_cast<size_t>(team)];
      const auto rows = static_cast<size_t>(n_minds(spec_.params, team));
      if (!w.values[team].empty()) {
        const std::vector<float> values = transposed(w.values[team], states, rows);
        mind.low = mind.high = values[0];
        const auto living = [&](size_t at) {
          const int died = w.died[at / states + (team ? static_cast<size_t>(spec_.params.n_team[0]) : 0)];
          return died < 0 || static_cast<int>(at % states) < died;
        };
        for (size_t at = 0; at < values.size(); ++at) {
          if (!living(at)) continue;
          mind.low = std::min(mind.low, values[at]);
          mind.high = std::max(mind.high, values[at]);
        }
        if (!(mind.low < mind.high)) mind.high = mind.low + 1;
        for (size_t at = 0; at < values.size(); ++at)
          mind.value.push_back(living(at) ? static_cast<uint8_t>(std::lround((values[at] - mind.low) /
                                                                             (mind.high - mind.low) * kReplayValues))
                                          : uint8_t{0});
      }
      if (w.likely[team].empty()) continue;
      mind.top = discrete ? kLikelyActions : 1;
      // [states, n, K] -> [K, n, states]
      const size_t per_row = discrete ? kLikelyActions : kActionSize;
      mind.likely = transposed(w.likely[team], states, rows * per_row);
      mind.probability = transposed(w.probability[team], discrete ? states : 0, rows * per_row);
      const auto by_rank = [&](std::vector<uint8_t>& column) {
        std::vector<uint8_t> to;
        for (size_t rank = 0; rank < per_row && !column.empty(); ++rank)
          for (size_t i = 0; i < rows; ++i) {
            const auto from = column.begin() + static_cast<std::ptrdiff_t>((i * per_row + rank) * states);
            to.insert(to.end(), from, from + static_cast<std::ptrdiff_t>(states));
          }
        column = std::move(to);
      };
      by_rank(mind.likely);
      by_rank(mind.probability);
    }
    if (!is_crowd(spec_.params))
      GIGA_CHECK(add_hits(w.pairs, spec_.params.min_tracking_time, e), "an episode of millions of hits");
    forget_the_dead(spec_.params, e);
    const std::string_view actions(reinterpret_cast<const char*>(e.action.data()), e.action.size());
    e.action_check = crc32_of(actions, crc32_of(seed));
  }
  return all;
}

}  // namespace giga
