#include "game/game.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "math/forget_episodes.hpp"
#include "sim/image_rows.hpp"
#include "sim/schedule.hpp"

namespace giga {

Game::Game(Simulator& sim, const ParallelFor& parallel_for, const BothSides& sides,
           std::vector<GameObserver*> observers)
    : sim_(sim), parallel_for_(parallel_for), observers_(std::move(observers)), layout_(observation_rows(sim.spec())) {
  for (int team = 0; team < kNTeams; ++team) {
    take_seats(sides[static_cast<size_t>(team)], team);
    memory_size_[team] = memory_size(sides[static_cast<size_t>(team)]);
  }
}

Game::~Game() = default;

int64_t memory_size(const Side& side) {
  int64_t size = 0;
  for (const SidePart& part : side) {
    const int64_t own = part.controller->memory_size();
    GIGA_CHECK(own == 0 || size == 0 || own == size, "controllers of one side remember ", own, " and ", size,
               " numbers");
    size = std::max(size, own);
  }
  return size;
}

void Game::take_seats(const Side& side, int team) {
  int64_t next = 0;
  for (const SidePart& part : side) {
    GIGA_CHECK(part.worlds.first == next && part.worlds.count > 0, "worlds ", part.worlds.first, " to ",
               part.worlds.end(), " after ", next);
    next = part.worlds.end();
    auto seat =
        std::find_if(seats_.begin(), seats_.end(), [&](const Seat& s) { return s.controller == part.controller; });
    if (seat == seats_.end()) seat = seats_.insert(seat, {part.controller, {}});
    seat->parts.push_back({team, part.worlds});
  }
  GIGA_CHECK(next == sim_.n_worlds(), "somebody moves team ", team, " in ", next, " of ", sim_.n_worlds(), " worlds");
}

void Game::start() {
  const GameStep step = begin(&Simulator::start);
  forget(step);
  finish(-1, step);
}

// What was loaded is remembered as it is.
void Game::resume() { finish(-1, begin(&Simulator::observe)); }

GameStep Game::begin(void (Simulator::*write)(const StepIo&)) {
  for (ObservationSet& reads : reads_) reads = {};
  for (const Seat& seat : seats_)
    for (const Part& part : seat.parts) reads_[part.team] |= seat.controller->reads();
  make_buffers();
  find_readers();
  const GameStep step = step_at(-1);
  (sim_.*write)(step.io);
  steps_ = 0;
  started_ = true;
  played_ = 0;
  return step;
}

void Game::watch(GameObserver& observer) {
  observers_.push_back(&observer);
  played_ = 0;
  if (started_) make_buffers();
}

void Game::make_buffers() {
  const GameStep asked = ask(0);
  for (int team = 0; team < kNTeams; ++team) {
    const auto make = [&]<class T>(int64_t per_agent, Buffer<T>& buffer) {
      const int64_t agents = static_cast<int64_t>(sim_.n_worlds()) * sim_.params().n_team[team];
      if (buffer.size() == 0) buffer = Buffer<T>(sim_.memory(), static_cast<size_t>(agents * per_agent));
    };
    const ObservationSet wanted = reads_[team] | asked.rows[team].wanted;
    // A discrete action is an int32, which takes the room of a float.
    if (!asked.team[team].action) make(sim_.params().actions == ActionKind::discrete ? 1 : kActionSize, action_[team]);
    if (!asked.rows[team].obs && !(wanted & layout_.set()).empty()) make(layout_.stride(), obs_[team]);
    if (!asked.io.team[team].obs[Observation::image].rows && wanted.has(Observation::image))
      make(image_bytes(sim_.params().resolution), image_[team]);
    if (!asked.team[team].memory) make(memory_size_[team], memory_[team]);
  }
}

/// Scripts may read other observations than networks do, and play in some worlds only: rows that nobody reads need not
/// be written. And networks may play in the mirror, scripts do not.
void Game::find_readers() {
  const GameStep asked = ask(0);
  for (int team = 0; team < kNTeams; ++team) {
    std::vector<uint8_t> sets(static_cast<size_t>(sim_.n_worlds()));
    for (const Seat& seat : seats_)
      for (const Part& part : seat.parts)
        if (part.team == team)
          seat.controller->reads_by_world(
              team, part.worlds.first,
              std::span(sets).subspan(static_cast<size_t>(part.worlds.first), static_cast<size_t>(part.worlds.count)));
    std::vector<uint8_t> mirrored(mirrors_half_ ? sets.size() : 0);
    for (size_t w = 0; w < mirrored.size(); ++w) {
      const int64_t world = sim_.options().first_world + static_cast<int64_t>(w);
      mirrored[w] = sets[w] == ObservationSet(Observation::egocentric).bits() && (world >> team & 1) != 0;
    }
    mirrored_[team].set(sim_, std::move(mirrored));

    watched_[team] = asked.rows[team].wanted;
    ObservationSet everywhere = watched_[team];  // and what observers have brought rows for
    for (int k = 0; k < kNObservations; ++k)
      if (const auto kind = static_cast<Observation>(k); asked.io.team[team].obs[kind].rows) everywhere |= kind;
    for (uint8_t& set : sets) set |= everywhere.bits();
    const uint8_t all = (reads_[team] | everywhere).bits();
    if (std::all_of(sets.begin(), sets.end(), [all](uint8_t set) { return set == all; })) sets.clear();
    readers_[team].set(sim_, std::move(sets));
  }
}

void Game::PerWorld::set(Simulator& sim, std::vector<uint8_t> wanted) {
  if (wanted == numbers) return;
  numbers = std::move(wanted);
  if (numbers.empty()) return;
  sim.synchronize();  // steps of a game before may still read the former ones
  if (buffer.size() == 0) buffer = Buffer<uint8_t>(sim.memory(), numbers.size());
  buffer.from_host(numbers);
}

void Game::desynchronize() {
  const int limit = sim_.params().max_episode_length;
  if (limit <= 1) return;
  std::vector<int32_t> ages(static_cast<size_t>(sim_.n_worlds()));
  for (size_t w = 0; w < ages.size(); ++w) {
    const auto world = static_cast<uint32_t>(sim_.options().first_world) + static_cast<uint32_t>(w);
    DrawKey key(sim_.options().seed, world, 0);
    ages[w] = static_cast<int32_t>(key.uniform(Draw::init, 0, 0) * static_cast<float>(limit));
    if (ages[w] >= limit) ages[w] = limit - 1;
  }
  sim_.synchronize();
  sim_.memory().from_host(sim_.state().view().episode_length, ages.data(), ages.size() * sizeof(int32_t));
  sim_.observe(step_at(-1).io);  // critics may read the age
}

void Game::play(int64_t n_steps) {
  GIGA_CHECK(started_, "the game has not started");
  for (GameObserver* observer : observers_) observer->before_play(n_steps);
  if (queue_play(n_steps)) return;
  const bool may_end = sim_.options().on_done == OnDone::freeze;
  bool records = may_end && refusal_.empty() && repeats();
  period_.reset();  // what it was made of may be another now
  for (int64_t t = 0; t < n_steps;) {
    const bool lists = sim_.steps_to_list() == 0;
    if (may_end && lists && sim_.over()) return;
    // The first steps are played one by one, so that all kernels are loaded and all memory is there.
    if (records && lists && t >= kListPeriod && n_steps - t >= kListPeriod) {
      records = queue_period(t);
      if (records) {
        t += kListPeriod;
        continue;
      }
    }
    const GameStep step = step_at(t);
    act(step, t > 0);
    sim_.step(step.io);
    forget(step);
    finish(t, step);
    ++steps_;
    ++t;
  }
}

bool Game::controllers_repeat(bool (TeamController::*alike)() const) const {
  const auto remembers = [this](int team) { return memory_size_[team] > 0; };
  return !remembers(0) && !remembers(1) &&
         std::all_of(seats_.begin(), seats_.end(), [&](const Seat& seat) { return (*seat.controller.*alike)(); });
}

/// Whether one step is like the other.
bool Game::repeats() const {
  return controllers_repeat(&TeamController::repeats) &&
         std::all_of(observers_.begin(), observers_.end(), [](const GameObserver* o) { return o->repeats(); });
}

/// Whether one play is like the other. A controller may ask for a step's number modulo kListPeriod.
bool Game::repeats_plays(int64_t n_steps) const {
  return sim_.options().on_done != OnDone::freeze && n_steps > 0 && n_steps % kListPeriod == 0 &&
         controllers_repeat(&TeamController::repeats_where_kept) &&
         std::all_of(observers_.begin(), observers_.end(), [](const GameObserver* o) { return o->repeats_plays(); });
}

/// A whole play in one call; false where it is to be queued step by step.
bool Game::queue_play(int64_t n_steps) {
  if (played_ != n_steps || n_steps == 0) {  // the first one loads the kernels
    play_.reset();
    played_ = refusal_.empty() && repeats_plays(n_steps) ? n_steps : 0;
    return false;
  }
  if (!play_) {
    const auto step = [this](int64_t k) { return play_step_ = step_at(k); };
    play_ = record(n_steps, step, [this](int64_t) {
      for (int team = 0; team < kNTeams; ++team) seen_[team] = play_step_.rows[team].obs;
    });
  }
  if (!play_) {
    played_ = 0;
    return false;
  }
  play_->queue();
  steps_ += n_steps;
  return true;
}

/// Queues the steps up to the next list in one call; false where the back end records nothing.
bool Game::queue_period(int64_t t) {
  if (!period_) record_period(t);
  if (!period_) return false;
  sim_.begin_steps(kListPeriod);
  period_->queue();
  steps_ += kListPeriod;
  for (GameObserver* observer : observers_) observer->after_recorded(period_step_);
  return true;
}

void Game::record_period(int64_t t) {
  period_step_ = step_at(t);
  const auto step = [this](int64_t) { return period_step_; };
  period_ = record(kListPeriod, step, [this](int64_t k) {
    for (GameObserver* observer : observers_) observer->record_step(static_cast<int>(k), period_step_);
  });
}

/// Steps 0 to n_steps - 1 as `step` has them; `recorded` comes behind each. Controllers and their shares act side by
/// side, because each leaves most of a GPU to others. Null where the back end records nothing.
std::unique_ptr<RecordedWork> Game::record(int64_t n_steps, const std::function<GameStep(int64_t k)>& step,
                                           const std::function<void(int64_t k)>& recorded) {
  try {
    std::vector<std::pair<const Seat*, int>> shares;
    for (const Seat& seat : seats_)
      for (int share = 0; share < seat.controller->n_shares(); ++share) shares.emplace_back(&seat, share);
    return sim_.record(shares.size(), [&](Recording& recording) {
      for (int64_t k = 0; k < n_steps; ++k) {
        const GameStep now = step(k);
        recording.side_by_side(shares.size(), [&](size_t at, void* stream) {
          const auto& [seat, share] = shares[at];
          const ParallelFor beside(sim_.device(), 0, stream);
          seat->controller->act_share(share, parts_of(*seat, now, steps_ + k, k > 0, beside));
        });
        sim_.queue_step(now.io);
        recorded(k);
      }
    });
  } catch (const DeviceError& e) {  // what fails one by one too will say so there
    refusal_ = e.what();
    return nullptr;
  }
}

/// What observers want of a step.
GameStep Game::ask(int64_t t) const {
  GameStep step;
  step.sim = &sim_;
  for (int team = 0; team < kNTeams; ++team) {
    step.team[team].obs = seen_[team];
    step.team[team].image = seen_image_[team];
  }
  for (GameObserver* observer : observers_) observer->before_step(t, step);
  return step;
}

GameStep Game::step_at(int64_t t) const {
  GameStep step = ask(t);
  for (int team = 0; team < kNTeams; ++team) {
    TeamIo& io = step.io.team[team];
    GameStep::Rows& rows = step.rows[team];
    if (!rows.obs) rows.obs = obs_[team].data();
    layout_.attach(io, rows.wanted | reads_[team], rows.obs, rows.final_obs);
    if (rows.wanted == watched_[team]) io.reads = readers_[team].data();
    io.mirrored = mirrored_[team].data();
    void*& images = io.obs[Observation::image].rows;
    if (!images && (rows.wanted | reads_[team]).has(Observation::image)) images = image_[team].data();
    if (!step.team[team].action) step.team[team].action = action_[team].data();
    io.action = step.team[team].action;
    if (!step.team[team].memory) step.team[team].memory = memory_[team].data();
    step.team[team].memory_size = memory_size_[team];
  }
  return step;
}

void Game::finish(int64_t t, const GameStep& step) {
  for (int team = 0; team < kNTeams; ++team) {
    seen_[team] = step.rows[team].obs;
    seen_image_[team] = static_cast<const uint8_t*>(step.io.team[team].obs[Observation::image].rows);
  }
  for (GameObserver* observer : observers_) observer->after_step(t, step);
}

/// Where an episode begins, nothing is remembered.
void Game::forget(const GameStep& step) {
  for (int team = 0; team < kNTeams; ++team) {
    if (memory_size_[team] == 0) continue;
    const int64_t per_world = sim_.params().n_team[team] * memory_size_[team];
    parallel_for_.run(ForgetEpisodes{sim_.state().view().episode_length, step.team[team].memory, per_world},
                      sim_.n_worlds() * per_world);
  }
}

void Game::act(const GameStep& step, bool behind_step) {
  for (const Seat& seat : seats_) seat.controller->act(parts_of(seat, step, steps_, behind_step, parallel_for_));
}

std::span<const TeamStep> Game::parts_of(const Seat& seat, const GameStep& step, int64_t number, bool behind_step,
                                         const ParallelFor& parallel_for) {
  // Of several controllers or shares the first alone is behind the step, or each is on a stream of its own.
  const bool alone = seats_.size() == 1 && seat.controller->n_shares() == 1;
  const bool behind = behind_step && alone && sim_.step_lets_next_begin();
  parts_.clear();
  for (const Part& part : seat.parts) {
    const TeamStep all{sim_,    parallel_for, part.team, number, {0, sim_.n_worlds()}, step.team[part.team],
                       layout_, behind};
    parts_.push_back(all.part(part.worlds));
  }
  return parts_;
}

}  // namespace giga
