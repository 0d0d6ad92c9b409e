#include "eval/recorder.hpp"

#include <torch/types.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "core/error.hpp"
#include "core/parallel_for.hpp"
#include "eval/recorded_world.hpp"
#include "learn/players/value_function.hpp"
#include "math/copy_pieces.hpp"
#include "math/distributions.hpp"
#include "policy/actor.hpp"
#include "policy/policy.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"
#include "sim/row_layout.hpp"
#include "sim/state_observation.hpp"

namespace giga {
namespace {

/// The likeliest actions of a row of logits, and their probabilities in units of 1 / kReplayShares.
void note_likely(const float* logits, std::vector<uint8_t>& likely, std::vector<uint8_t>& probability) {
  struct Best {
    float share = -1;
    int action = 0;
  } best[kLikelyActions];  // the first of equal ones before the others
  float sum = 0;
  const float top = *std::max_element(logits, logits + kNDiscreteActions);
  for (int k = 0; k < kNDiscreteActions; ++k) {
    const float share = std::exp(logits[k] - top);
    sum += share;
    int place = kLikelyActions;
    for (; place > 0 && share > best[place - 1].share; --place)
      if (place < kLikelyActions) best[place] = best[place - 1];
    if (place < kLikelyActions) best[place] = {share, k};
  }
  for (const Best& one : best) {
    likely.push_back(static_cast<uint8_t>(one.action));
    probability.push_back(static_cast<uint8_t>(std::lround(one.share / sum * kReplayShares)));
  }
}

}  // namespace

/// What the networks know of the games so far: [W n, S] by team.
struct Recorder::Remembered {
  std::array<NetworkState, kNTeams> policies, critics;
};

/// States on the device.
struct Recorder::Kept {
  int64_t most = 0, count = 0;
  at::Tensor bytes;             // [most, B] the state of the worlds, laid out as `fields` and `lists` say
  at::Tensor actions[kNTeams];  // [most, W n B] bytes of the actions that led there; of the first state nothing
  at::Tensor numbers[kNTeams];  // [most, W n, D] that agents see, where a network reads them
  at::Tensor images[kNTeams];   // [most, W n, R R 3] likewise
  at::Tensor alive;             // [most, W, N] bytes, where a network is asked
  at::Tensor truth;             // [most, W, G] where a critic reads it

  StateShape shape = 0;
  const uint8_t* first = nullptr;  // the first state, while it is kept
  StateView fields{};              // of that; those of pairs are null in a crowd
  PairLists lists;
  std::unique_ptr<ParallelFor> parallel_for;

  std::array<at::Tensor*, 9> rooms() {
    return {&bytes, &actions[0], &actions[1], &numbers[0], &numbers[1], &images[0], &images[1], &alive, &truth};
  }
  /// Bytes of a state.
  static int64_t row(const at::Tensor& room) { return static_cast<int64_t>(room.nbytes()) / room.size(0); }
  /// Where something of the first state lies in another.
  template <class T>
  T* field(T* there, const uint8_t* state) const {
    const uint8_t* at = state + (reinterpret_cast<const uint8_t*>(there) - first);
    return there ? reinterpret_cast<T*>(const_cast<uint8_t*>(at)) : nullptr;
  }
  void run(const CopyPieces& copy) const {
    if (parallel_for->device().is_cuda()) return parallel_for->run(copy, copy.n_rows());
    for (int k = 0; k < copy.count; ++k)
      std::memcpy(copy.piece[k].to, copy.piece[k].from, static_cast<size_t>(copy.piece[k].bytes));
  }
};

/// States that were fetched, and what the networks make of them; on the host.
struct Recorder::Fetched {
  int64_t count = 0;
  at::Tensor bytes, actions[kNTeams];  // [count, ..] as in Kept
  at::Tensor head[kNTeams];            // [count W n, ..] of the policies
  at::Tensor value[kNTeams];           // [count W, n]
};

Recorder::Recorder(const SimSpec& spec, const Minds& minds, const RecorderOptions& options)
    : spec_(spec.with_time_limit()),
      minds_(minds),
      options_(options),
      remembered_(std::make_unique<Remembered>()),
      waiting_(std::make_unique<Kept>()),
      recorded_(std::make_unique<Kept>()),
      fetched_(std::make_unique<Fetched>()) {
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

bool Recorder::over() const {
  return std::all_of(worlds_.begin(), worlds_.end(), [](const RecordedWorld& w) { return w.over; });
}

int64_t Recorder::first_world(const Simulator& sim) const { return sim.n_worlds() - static_cast<int>(worlds_.size()); }

void Recorder::after_step(int64_t t, const GameStep& step) {
  const Simulator& sim = *step.sim;
  if (t < 0) {
    GIGA_CHECK(sim.options().on_done == OnDone::freeze && sim.options().episodes == 1, "this is no match");
    GIGA_CHECK(options_.worlds <= sim.n_worlds(), options_.worlds, " worlds of ", sim.n_worlds());
    const int64_t most = spec_.params.max_episode_length + 1;
    worlds_.assign(static_cast<size_t>(options_.worlds > 0 ? options_.worlds : sim.n_worlds()),
                   RecordedWorld(spec_.params, most));
    make_rooms(step);
  } else if (over()) {
    return;
  }
  make_room(1);
  keep(step, *waiting_, waiting_->count++);
}

bool Recorder::repeats() const { return recorded_->most > 0; }

void Recorder::record_step(int k, const GameStep& step) { keep(step, *recorded_, k); }

void Recorder::after_recorded(const GameStep&) {
  if (over()) return;
  make_room(kListPeriod);
  CopyPieces copy;
  const auto from = recorded_->rooms(), to = waiting_->rooms();
  for (size_t k = 0; k < from.size(); ++k) {
    if (!from[k]->defined()) continue;
    const int64_t row = Kept::row(*from[k]);
    copy.add(from[k]->data_ptr(), static_cast<uint8_t*>(to[k]->data_ptr()) + waiting_->count * row, kListPeriod * row);
  }
  waiting_->run(copy);
  waiting_->count += kListPeriod;
}

/// For so many more states.
void Recorder::make_room(int64_t states) {
  if (waiting_->count + states <= waiting_->most) return;
  fetch();
  note();  // by which it is known whether the games are over
}

void Recorder::finish() {
  fetch();
  for (Kept* kept : {waiting_.get(), recorded_.get()})
    for (at::Tensor* room : kept->rooms()) *room = at::Tensor();
  true_state_ = Buffer<float>();
}

// Rooms that nobody has written to take no memory of a CPU yet.
void Recorder::fill() {
  for (Kept* kept : {waiting_.get(), recorded_.get()})
    for (at::Tensor* room : kept->rooms())
      if (room->defined()) room->zero_();
  waiting_->count = waiting_->most;
}

/// Asks the networks of what waits, and brings it to the host.
void Recorder::fetch() {
  Kept& from = *waiting_;
  if (from.count == 0) return;
  Fetched& to = *fetched_;
  ask(to);  // first, so that the device has it all before the host waits
  const auto on_host = [&](const at::Tensor& rows) { return rows.narrow(0, 0, from.count).to(at::kCPU).contiguous(); };
  to.count = from.count;
  to.bytes = on_host(from.bytes);
  for (size_t team = 0; team < kNTeams; ++team) {
    to.actions[team] = on_host(from.actions[team]);
    for (at::Tensor* answer : {&to.head[team], &to.value[team]})
      if (answer->defined()) *answer = answer->to(at::kCPU).contiguous();
  }
  from.count = 0;
}

/// Notes what was fetched.
void Recorder::note() {
  Fetched& from = *fetched_;
  std::vector<int> states;  // [count, W] that a world had by then, this one included
  const auto row = [](const at::Tensor& rows, int64_t k) { return rows.const_data_ptr<uint8_t>() + k * rows.size(1); };
  for (int64_t k = 0; k < from.count && !over(); ++k) {
    if (noted_++ > 0) note_actions({row(from.actions[0], k), row(from.actions[1], k)});
    note_state(row(from.bytes, k));
    for (const RecordedWorld& world : worlds_) states.push_back(world.states);
  }
  note_minds(states);
  from = {};
}

void Recorder::note_state(const uint8_t* bytes) {
  const Kept& from = *waiting_;
  const auto n_agents = static_cast<int64_t>(from.shape.n_agents);
  const RecordedUnits units{place_unit(std::max(spec_.params.limit_x, spec_.params.limit_y), spec_.params.n_agents),
                            health_unit(most_health(spec_))};
  for (size_t world = 0; world < worlds_.size(); ++world) {
    const auto w = static_cast<int64_t>(world);
    if (!worlds_[world].over) {
      WorldView view{};
      for_each_field([&](auto field, auto member) {
        auto* const first = from.field(from.fields.*member, bytes);
        view.*member = first ? first + w * field.count(spec_.params.n_agents) : nullptr;
      });
      RecordedLists lists{nullptr, nullptr, 0};
      if (from.shape.lists())
        lists = {from.field(from.lists.fire, bytes) + w * n_agents * from.shape.shooters,
                 from.field(from.lists.neighbors, bytes) + w * n_agents * from.shape.rows, from.shape.shooters};
      worlds_[world].note(spec_, view, lists, units);
    }
  }
}

void Recorder::note_actions(const uint8_t* const (&actions)[kNTeams]) {
  const bool discrete = spec_.params.actions == ActionKind::discrete;
  const size_t size = discrete ? sizeof(int32_t) : kActionSize * sizeof(float);
  for (int team = 0; team < kNTeams; ++team) {
    const size_t row = static_cast<size_t>(spec_.params.n_team[team]) * size;
    for (size_t w = 0; w < worlds_.size(); ++w) {
      if (worlds_[w].over) continue;
      const uint8_t* from = actions[team] + w * row;
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

/// For what is kept, and what the networks read, of as many states as may wait; and for those of steps that are
/// recorded.
void Recorder::make_rooms(const GameStep& step) {
  const Simulator& sim = *step.sim;
  const StateShape& shape = sim.state().shape();
  const auto w = static_cast<int64_t>(worlds_.size());
  const auto asks = [](const Mind& mind) { return mind.policy || mind.values; };
  const auto remembers = [](const Mind& mind) {
    return (mind.policy && mind.policy->state_size() > 0) || (mind.values && mind.values->state_size() > 0);
  };
  const bool at_once = std::any_of(minds_.begin(), minds_.end(), remembers);

  const auto make = [&](int64_t most, Kept& to) {
    to.most = most;
    to.shape = shape;
    to.parallel_for = std::make_unique<ParallelFor>(sim.device(), 1, current_stream(sim.device()));
    int64_t bytes = 0;  // of a state
    const auto room = [&](at::Tensor& tensor, std::vector<int64_t> sizes, at::ScalarType type) {
      sizes.insert(sizes.begin(), most);
      tensor = at::empty(sizes, at::TensorOptions().dtype(type).device(torch_device(sim.device())));
      bytes += Kept::row(tensor);
    };
    room(to.bytes, {static_cast<int64_t>(state_bytes(shape, w))}, at::kByte);
    to.first = to.bytes.const_data_ptr<uint8_t>();
    lay_out_state(shape, w, to.bytes.data_ptr<uint8_t>(), to.fields, to.lists);
    const int64_t action = spec_.params.actions == ActionKind::discrete ? sizeof(int32_t) : kActionSize * sizeof(float);
    for (int team = 0; team < kNTeams; ++team) {
      const Mind& mind = minds_[static_cast<size_t>(team)];
      const int64_t rows = w * spec_.params.n_team[team];
      room(to.actions[team], {rows * action}, at::kByte);
      if (!asks(mind)) continue;
      const auto reads = [&](bool image) {
        return (mind.policy && mind.policy->reads_image() == image) ||
               (mind.values && mind.values->reads_image() == image);
      };
      if (reads(false) && step.rows[team].obs)
        room(to.numbers[team], {rows, observation_rows(spec_).stride()}, at::kFloat);
      if (reads(true)) room(to.images[team], {rows, image_bytes(spec_.params.resolution)}, at::kByte);
    }
    if (std::any_of(minds_.begin(), minds_.end(), asks)) room(to.alive, {w, spec_.params.n_agents}, at::kByte);
    if (step.io.world[Observation::state].rows) room(to.truth, {w, spec_.state_size()}, at::kFloat);
    return bytes;
  };
  const int64_t bytes = make(at_once ? 1 : kListPeriod, *recorded_);
  const int64_t states = spec_.params.max_episode_length + kListPeriod;  // so that the last list fits in
  // Of many images at once what lies between the layers of an encoder would take gigabytes.
  constexpr int64_t kMostOfImages = 64;
  const bool images = recorded_->images[0].defined() || recorded_->images[1].defined();
  const int64_t most = std::min(options_.most_bytes / bytes, images ? std::min(states, kMostOfImages) : states);
  make(at_once ? 1 : std::max<int64_t>(most, kListPeriod), *waiting_);
  if (at_once) *recorded_ = {};
}

/// Keeps a state, the actions that led there, and what the networks read of it.
void Recorder::keep(const GameStep& step, Kept& to, int64_t at) const {
  const Simulator& sim = *step.sim;
  const int64_t first = first_world(sim), w = static_cast<int64_t>(worlds_.size());
  CopyPieces copy;
  const auto place = [at](const at::Tensor& room) {
    return static_cast<uint8_t*>(room.data_ptr()) + at * Kept::row(room);
  };
  // Of arrays of all worlds, those of the last ones.
  const auto keep = [&](const at::Tensor& room, const void* from) {
    if (!room.defined()) return;
    const int64_t bytes = Kept::row(room);
    copy.add(static_cast<const uint8_t*>(from) + bytes / w * first, place(room), bytes);
  };
  StateView from = sim.state().view();
  PairLists lists = sim.state().lists();
  std::vector<std::pair<const void*, int64_t>> arrays;
  for_each_array(to.shape, from, lists, [&](const char*, const auto* array, int64_t per_world) {
    const auto bytes = per_world * static_cast<int64_t>(sizeof *array);
    arrays.emplace_back(reinterpret_cast<const uint8_t*>(array) + first * bytes, bytes * w);
  });
  size_t k = 0;
  for_each_array(to.shape, to.fields, to.lists, [&](const char*, auto* array, int64_t) {
    copy.add(arrays[k].first, to.field(array, place(to.bytes)), arrays[k].second);
    ++k;
  });
  for (int team = 0; team < kNTeams; ++team) {
    keep(to.actions[team], step.team[team].action);
    keep(to.numbers[team], step.rows[team].obs);
    keep(to.images[team], step.io.team[team].obs[Observation::image].rows);
  }
  keep(to.alive, sim.state().view().alive);
  keep(to.truth, step.io.world[Observation::state].rows);
  to.run(copy);
}

/// What the networks make of the states that wait; on the device.
void Recorder::ask(Fetched& to) {
  at::NoGradGuard no_grad;
  const Kept& from = *waiting_;
  const auto w = static_cast<int64_t>(worlds_.size()), count = from.count;
  // Rows of all states: [count, R, ...] -> [count R, ...]; undefined where there are none.
  const auto all = [&](const at::Tensor& room) {
    return room.defined() ? room.narrow(0, 0, count).flatten(0, 1) : at::Tensor();
  };
  for (int team = 0; team < kNTeams; ++team) {
    const auto side = static_cast<size_t>(team);
    const Mind& mind = minds_[side];
    const auto seen = [&](bool image) { return all(image ? from.images[team] : from.numbers[team]); };
    if (mind.policy) {
      const at::Tensor obs = seen(mind.policy->reads_image());
      const auto* const actor = dynamic_cast<const Actor*>(mind.policy);
      std::optional<at::Tensor> head;
      if (actor && obs.is_cuda()) head = actor->small_head(obs, *from.parallel_for);
      to.head[side] = head ? *head : mind.policy->forward(obs, remembered_->policies[side]);
      if (spec_.params.actions == ActionKind::continuous) to.head[side] = to.head[side].tanh();
    }
    if (!mind.values) continue;
    const int64_t n = spec_.params.n_team[team], first = team == 0 ? 0 : spec_.params.n_team[0];
    const at::Tensor alive = all(from.alive).narrow(1, first, n);
    const at::Tensor state = mind.values->needs_state() ? all(from.truth) : at::Tensor();
    at::Tensor obs = seen(mind.values->reads_image());
    if (obs.defined()) obs = obs.view({count * w, n, -1});
    to.value[side] = mind.values->forward(obs, alive, state, remembered_->critics[side]);
  }
}

/// One row for each state, that of the end included.
void Recorder::note_minds(const std::vector<int>& states) {
  for (size_t team = 0; team < kNTeams; ++team) {
    const at::Tensor &head = fetched_->head[team], &value = fetched_->value[team];
    const int64_t n = spec_.params.n_team[team], kept = n_minds(spec_.params, static_cast<int>(team));
    for (size_t at = 0; at < states.size(); ++at) {
      RecordedWorld& world = worlds_[at % worlds_.size()];
      const auto rows_so_far = static_cast<size_t>(states[at] * kept);
      const auto first = static_cast<int64_t>(at) * n;
      if (head.defined() && world.likely[team].size() < rows_so_far * kLikelyActions) {
        const float* row = head.const_data_ptr<float>() + first * head.size(1);
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
        const float* row = value.const_data_ptr<float>() + first;
        world.values[team].insert(world.values[team].end(), row, row + kept);
      }
    }
  }
}

std::vector<ReplayEpisode> Recorder::episodes(const std::string& seed) {
  finish();
  note();
  std::vector<ReplayEpisode> all;
  for (const RecordedWorld& w : worlds_) all.push_back(episode_of(w, spec_.params, seed));
  return all;
}

}  // namespace giga
