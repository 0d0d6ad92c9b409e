#include "eval/recorder.hpp"

#include <torch/types.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>

#include "core/error.hpp"
#include "core/parallel_for.hpp"
#include "eval/recorded_world.hpp"
#include "learn/players/value_function.hpp"
#include "math/copy_pieces.hpp"
#include "math/distributions.hpp"
#include "policy/policy.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"
#include "sim/image_rows.hpp"
#include "sim/row_layout.hpp"
#include "sim/state_observation.hpp"

namespace giga {
namespace {

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

}  // namespace

/// What the networks know of the games so far: [W n, S] by team.
struct Recorder::Remembered {
  std::array<NetworkState, kNTeams> policies, critics;
};

/// States that are not noted yet, on the device: the host waits once for many, and a GPU takes as long to ask its
/// networks for one as for many. Those that remember are asked of each state at once.
struct Recorder::Waiting {
  static constexpr int64_t kMost = 64, kMostBytes = int64_t{1} << 26;
  int64_t most = 1, count = 0, noted = 0;  // states
  std::unique_ptr<ParallelFor> parallel_for;
  StateView fields{};  // of the simulator, for where they lie in its bytes; those of pairs are null in a crowd
  PairLists lists;
  StateShape shape = 0;
  at::Tensor bytes;             // [most, B] state of all worlds
  at::Tensor actions[kNTeams];  // [most, W n B] bytes of the actions that led there; of the first state nothing
  at::Tensor numbers[kNTeams];  // [most, W n, D] that agents see, where a network reads them
  at::Tensor images[kNTeams];   // [most, W n, R R 3] likewise
  at::Tensor alive;             // [most, W, N] bytes, where a network is asked
  at::Tensor truth;             // [most, W, G] where a critic reads it
  std::vector<int> states;      // [count, W] that a world had by then, this one included

  template <class T>
  T* field(T* there, const uint8_t* state) const {
    const auto* first = reinterpret_cast<const uint8_t*>(fields.x);  // the first of the field list
    const uint8_t* at = state + (reinterpret_cast<const uint8_t*>(there) - first);
    return there ? reinterpret_cast<T*>(const_cast<uint8_t*>(at)) : nullptr;
  }
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

bool Recorder::over() const {
  return std::all_of(worlds_.begin(), worlds_.end(), [](const RecordedWorld& w) { return w.over; });
}

void Recorder::after_step(int64_t t, const GameStep& step) {
  const Simulator& sim = *step.sim;
  if (t < 0) {
    GIGA_CHECK(sim.options().on_done == OnDone::freeze && sim.options().episodes == 1, "this is no match");
    const int64_t most = spec_.params.max_episode_length + 1;
    worlds_.assign(static_cast<size_t>(sim.n_worlds()), RecordedWorld(spec_.params, most));
    make_room(step);
  } else if (over()) {
    return;
  }
  put_off(step);
  if (waiting_->count == waiting_->most) note();
}

/// Notes the states that wait.
void Recorder::note() {
  Waiting& from = *waiting_;
  if (from.count == 0) return;
  const auto on_host = [&](const at::Tensor& rows) { return rows.narrow(0, 0, from.count).to(at::kCPU).contiguous(); };
  const at::Tensor bytes = on_host(from.bytes), actions[kNTeams] = {on_host(from.actions[0]), on_host(from.actions[1])};
  const auto row = [](const at::Tensor& rows, int64_t k) { return rows.const_data_ptr<uint8_t>() + k * rows.size(1); };
  for (int64_t k = 0; k < from.count && !over(); ++k) {
    if (from.noted++ > 0) note_actions({row(actions[0], k), row(actions[1], k)});
    note_state(row(bytes, k));
  }
  ask_minds();
  from.count = 0;
  from.states.clear();
}

void Recorder::note_state(const uint8_t* bytes) {
  const Waiting& from = *waiting_;
  const auto n_agents = static_cast<int64_t>(from.shape.n_agents);
  const float unit = place_unit(std::max(spec_.params.limit_x, spec_.params.limit_y), spec_.params.n_agents);
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
      worlds_[world].note(spec_, view, lists, unit);
    }
    waiting_->states.push_back(worlds_[world].states);
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

/// For what is kept, and what the networks read, of as many states as may wait.
void Recorder::make_room(const GameStep& step) {
  const Simulator& sim = *step.sim;
  Waiting& to = *waiting_;
  to.parallel_for = std::make_unique<ParallelFor>(sim.device(), 1, current_stream(sim.device()));
  to.shape = sim.state().shape();
  to.fields = sim.state().view();
  to.lists = sim.state().lists();
  const auto w = static_cast<int64_t>(worlds_.size());
  const auto asks = [](const Mind& mind) { return mind.policy || mind.values; };
  const auto remembers = [](const Mind& mind) {
    return (mind.policy && mind.policy->state_size() > 0) || (mind.values && mind.values->state_size() > 0);
  };
  const bool at_once = std::any_of(minds_.begin(), minds_.end(), remembers);

  int64_t bytes = 0;  // of a state
  std::vector<std::pair<at::Tensor*, at::Tensor>> rooms;
  const auto room = [&](at::Tensor& tensor, at::IntArrayRef sizes, at::ScalarType type) {
    const at::Tensor one = at::empty(sizes, at::TensorOptions().dtype(type).device(torch_device(sim.device())));
    bytes += static_cast<int64_t>(one.nbytes());
    rooms.emplace_back(&tensor, one);
  };
  room(to.bytes, {static_cast<int64_t>(state_bytes(to.shape, w))}, at::kByte);
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
  to.most = at_once ? 1 : std::clamp<int64_t>(Waiting::kMostBytes / bytes, 1, Waiting::kMost);
  for (auto& [tensor, one] : rooms) {
    std::vector<int64_t> sizes = one.sizes().vec();
    sizes.insert(sizes.begin(), to.most);
    *tensor = at::empty(sizes, one.options());
  }
}

/// Keeps a state, the actions that led there, and what the networks read of it.
void Recorder::put_off(const GameStep& step) {
  Waiting& to = *waiting_;
  CopyPieces copy;
  const auto keep = [&](const at::Tensor& room, const void* from) {
    if (!room.defined()) return;
    const auto bytes = static_cast<int64_t>(room.nbytes()) / to.most;  // of a state
    copy.add(from, static_cast<uint8_t*>(room.data_ptr()) + to.count * bytes, bytes);
  };
  keep(to.bytes, to.fields.x);
  for (int team = 0; team < kNTeams; ++team) {
    if (to.noted + to.count > 0) keep(to.actions[team], step.team[team].action);
    keep(to.numbers[team], step.rows[team].obs);
    keep(to.images[team], step.io.team[team].obs[Observation::image].rows);
  }
  keep(to.alive, step.sim->state().view().alive);
  keep(to.truth, step.io.world[Observation::state].rows);
  to.parallel_for->run(copy, copy.n_rows());
  ++to.count;
}

/// What the networks make of the states that wait and were noted.
void Recorder::ask_minds() {
  at::NoGradGuard no_grad;
  const Waiting& from = *waiting_;
  const auto w = static_cast<int64_t>(worlds_.size()), count = static_cast<int64_t>(from.states.size()) / w;
  if (count == 0) return;
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
      RecordedWorld& world = worlds_[static_cast<size_t>(at % w)];
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
}

std::vector<ReplayEpisode> Recorder::episodes(const std::string& seed) {
  note();
  std::vector<ReplayEpisode> all;
  for (const RecordedWorld& w : worlds_) all.push_back(episode_of(w, spec_.params, seed));
  return all;
}

}  // namespace giga
