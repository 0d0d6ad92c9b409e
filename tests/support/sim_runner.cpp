// Buffers, poison and comparison of SimRunner.
#include "support/sim_runner.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <type_traits>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "sim/grid.hpp"
#include "sim/observations.hpp"

namespace giga::test {
namespace {

constexpr size_t kMostReported = 8;

template <class T>
T read(const SnapshotField& field, size_t index) {
  T value;
  std::memcpy(&value, field.bytes.data() + index * field.element, sizeof(value));
  return value;
}

std::string print(const SnapshotField& field, size_t index) {
  if (field.element == 1) return cat(static_cast<int>(field.bytes[index]));
  const uint32_t bits = read<uint32_t>(field, index);
  if (!field.is_float) return cat(bits);
  char text[64];
  std::snprintf(text, sizeof(text), "%.9g (0x%08x)", static_cast<double>(read<float>(field, index)), bits);
  return text;
}

/// Of a state with lists of fire: the tables [N, N] that they stand for.
std::vector<uint8_t> tracked_by_pair(const SimState& state, int n_worlds) {
  const StateShape& shape = state.shape();
  const auto n = static_cast<size_t>(shape.n_agents), most = static_cast<size_t>(shape.shooters);
  if (!shape.lists()) return {};
  std::vector<uint8_t> tracked(n * n * static_cast<size_t>(n_worlds));
  for (size_t target = 0; target < n * static_cast<size_t>(n_worlds); ++target)
    for (size_t k = 0; k < most; ++k) {
      const uint32_t entry = state.lists().fire[target * most + k];
      if (entry != 0)
        tracked[target * n + static_cast<size_t>(shooter_of(entry))] = static_cast<uint8_t>(count_of(entry));
    }
  return tracked;
}

}  // namespace

const SnapshotField& Snapshot::field(const std::string& name) const {
  for (const SnapshotField& f : fields)
    if (f.name == name) return f;
  throw Error("no field " + name);
}

float Snapshot::float_at(const std::string& name, size_t index) const { return read<float>(field(name), index); }

Snapshot observations(const Snapshot& snapshot) {
  Snapshot part;
  part.n_worlds = snapshot.n_worlds;
  for (const SnapshotField& f : snapshot.fields)
    if (f.observed) part.fields.push_back(f);
  return part;
}

void keep_observations(Snapshot& kept, const Snapshot& before, const Snapshot& after) {
  for (SnapshotField& f : kept.fields) {
    const size_t size = f.per_world * f.element;
    for (size_t w = 0; w < kept.n_worlds; ++w)
      if (static_cast<Phase>(before.byte_at("phase", w)) == Phase::plays)
        std::memcpy(f.bytes.data() + w * size, after.field(f.name).bytes.data() + w * size, size);
  }
}

std::string difference(const Snapshot& expected, const Snapshot& actual) {
  if (expected.n_worlds != actual.n_worlds || expected.fields.size() != actual.fields.size())
    return "snapshots of different shape";
  std::string report;
  for (size_t f = 0; f < expected.fields.size(); ++f) {
    const SnapshotField &a = expected.fields[f], &b = actual.fields[f];
    if (a.name != b.name || a.bytes.size() != b.bytes.size())
      return cat(report, "field ", a.name, " has another shape");
    if (a.bytes == b.bytes) continue;
    size_t count = 0;
    for (size_t k = 0; k < a.bytes.size() / a.element; ++k) {
      if (std::memcmp(a.bytes.data() + k * a.element, b.bytes.data() + k * a.element, a.element) == 0) continue;
      if (++count > kMostReported) continue;
      const size_t in_world = k % a.per_world;
      report += cat("\n  ", a.name, ": world ", k / a.per_world, ", agent ", in_world / a.per_agent, ", index ",
                    in_world % a.per_agent, ": expected ", print(a, k), ", got ", print(b, k));
    }
    report += cat("\n  ", a.name, ": ", count, " of ", a.bytes.size() / a.element, " differ");
  }
  return report;
}

std::vector<uint8_t> random_actions(const SimSpec& spec, int team, int n_worlds, uint64_t seed) {
  const size_t rows = static_cast<size_t>(n_worlds) * static_cast<size_t>(spec.params.n_team[team]);
  const bool discrete = spec.params.actions == ActionKind::discrete;
  const size_t columns = discrete ? 1 : kActionSize;
  std::vector<uint8_t> bytes(rows * columns * 4);
  DrawKey key(seed, static_cast<uint32_t>(team), 0);
  for (size_t k = 0; k < rows * columns; ++k) {
    const float u = key.uniform(Draw::action, static_cast<uint32_t>(k / 4), static_cast<uint32_t>(k % 4));
    const float control = 2.4f * u - 1.2f;
    const int32_t index = static_cast<int32_t>(u * 29) - 1;
    std::memcpy(bytes.data() + k * 4, discrete ? static_cast<const void*>(&index) : &control, 4);
  }
  return bytes;
}

SimRunner::SimRunner(std::unique_ptr<Simulator> sim, Outputs outputs, int row_step) : sim_(std::move(sim)) {
  const SimParams& p = sim_->params();
  if (p.has_term_factors) {
    float factors[kNRewardTerms];  // 1, 0.9, ... 0
    for (int t = 0; t < kNRewardTerms; ++t) factors[t] = 0.1f * static_cast<float>(kNRewardTerms - 1 - t);
    sim_->memory().from_host(sim_->term_factors(), factors, sizeof factors);
  }
  const size_t n = static_cast<size_t>(p.n_agents);
  const bool all = outputs == Outputs::all;
  for (size_t t = 0; t < kNTeams; ++t) {
    TeamIo& io = io_.team[t];
    const size_t rows = static_cast<size_t>(p.n_team[t]);
    const size_t width = p.actions == ActionKind::discrete ? 1 : kActionSize;
    actions_[t] = Buffer<uint8_t>(sim_->memory(), rows * width * 4 * static_cast<size_t>(sim_->n_worlds()));
    io.action = actions_[t].data();
    if (outputs == Outputs::none) continue;
    const std::string team = cat(" of team ", t);
    for_each_observation([&](auto kind) {
      if (kind.of == ObservationOf::world || !kind.offered(p)) return;
      if (outputs == Outputs::egocentric && kind.id != Observation::egocentric) return;
      io.obs[kind.id] = add_observation(kind.name + team, kind.type, rows, kind.shape(p).size(), row_step, all);
    });
    const auto by_world = [&](Buffer<uint8_t>& buffer, auto&& number_of) {
      std::vector<uint8_t> numbers(static_cast<size_t>(sim_->n_worlds()));
      for (size_t w = 0; w < numbers.size(); ++w) numbers[w] = static_cast<uint8_t>(number_of(w));
      buffer = Buffer<uint8_t>(sim_->memory(), numbers.size());
      buffer.from_host(numbers);
      return buffer.data();
    };
    if (outputs == Outputs::by_world || outputs == Outputs::in_mirror)
      io.reads = by_world(reads_[t], [t](size_t w) { return (5 * w + 3 * t) % 16; });
    if (outputs == Outputs::in_mirror) io.mirrored = by_world(mirrored_[t], [t](size_t w) { return w >> t & 1; });
    if (!all) continue;
    io.reward = static_cast<float*>(add("reward" + team, rows, 1, 4, true));
    io.alive = static_cast<uint8_t*>(add("alive" + team, rows, 1, 1, false, true));
    io.final_alive = static_cast<uint8_t*>(add("final_alive" + team, rows, 1, 1, false));
  }
  if (!all) return;
  io_.done = static_cast<uint8_t*>(add("done", 1, 1, 1, false));
  for_each_observation([&](auto kind) {
    if (kind.of == ObservationOf::world && kind.offered(p))
      io_.world[kind.id] = add_observation(kind.name, kind.type, 1, kind.shape(p).size(), row_step, true);
  });
  io_.terms = static_cast<float*>(add("terms [term][agent]", n * kNRewardTerms, n, 4, true));
}

ObservationIo SimRunner::add_observation(const std::string& name, ElementType type, size_t rows, int size, int row_step,
                                         bool final) {
  const int stride = row_step > 0 ? size / row_step * row_step + row_step : size;
  const auto columns = static_cast<size_t>(stride);
  const auto element = static_cast<size_t>(size_of(type));
  const bool is_float = type == ElementType::f32;
  const auto add_rows = [&](const std::string& rows_name, bool observed) {
    void* first = add(rows_name, rows * columns, columns, element, is_float, observed);
    if (row_step == kZerosBehind) outputs_.back().zeros_behind = (columns - static_cast<size_t>(size)) * element;
    return first;
  };
  return {add_rows(name, true), final ? add_rows("final " + name, false) : nullptr, row_step > 0 ? stride : 0,
          row_step == kZerosBehind ? stride : 0};
}

void* SimRunner::add(const std::string& name, size_t per_world, size_t per_agent, size_t element, bool is_float,
                     bool observed) {
  Output output;
  output.shape.name = name;
  output.shape.per_world = per_world;
  output.shape.per_agent = per_agent;
  output.shape.element = element;
  output.shape.is_float = is_float;
  output.shape.observed = observed;
  output.buffer = Buffer<uint8_t>(sim_->memory(), per_world * element * static_cast<size_t>(sim_->n_worlds()));
  outputs_.push_back(std::move(output));
  return outputs_.back().buffer.data();
}

void SimRunner::poison() {
  for (Output& output : outputs_) {
    std::vector<uint8_t> bytes(output.buffer.size(), kPoison);
    const size_t row = output.shape.per_agent * output.shape.element, zeros = output.zeros_behind;
    for (size_t end = row; zeros > 0 && end <= bytes.size(); end += row)
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(end - zeros), zeros, uint8_t{0});
    output.buffer.from_host(bytes);
  }
}

void SimRunner::start() {
  poison();
  sim_->start(io_);
  sim_->synchronize();
}

void SimRunner::observe() {
  poison();
  sim_->observe(io_);
  sim_->synchronize();
}

void SimRunner::step(uint64_t action_seed) {
  poison();
  for (int t = 0; t < kNTeams; ++t)
    actions_[t].from_host(random_actions(sim_->spec(), t, sim_->n_worlds(), action_seed));
  sim_->step(io_);
  sim_->synchronize();
}

void SimRunner::queue_step() { sim_->queue_step(io_); }

std::unique_ptr<RecordedWork> SimRunner::record_step() {
  return sim_->record(0, [this](Recording&) { queue_step(); });
}

Snapshot SimRunner::snapshot() {
  Snapshot shot;
  shot.n_worlds = static_cast<size_t>(sim_->n_worlds());
  const int n_agents = sim_->params().n_agents;
  SimState on_host(sim_->state().shape(), sim_->n_worlds(), host_memory());
  on_host.load(sim_->state().save());
  const std::vector<uint8_t> tracked = tracked_by_pair(on_host, sim_->n_worlds());
  for_each_field([&](auto kind, auto member) {
    const auto* field = on_host.view().*member;
    if constexpr (kind.per == Per::pair)
      if (!field) field = tracked.data();
    if (!field) return;
    const auto per_world = static_cast<size_t>(kind.count(n_agents));
    using T = std::remove_cvref_t<decltype(*field)>;
    SnapshotField f;
    f.name = kind.name;
    f.per_world = per_world;
    const size_t n = static_cast<size_t>(n_agents);
    f.per_agent = per_world % n == 0 && per_world >= n ? per_world / n : per_world;
    f.element = sizeof(T);
    f.is_float = std::is_same_v<T, float>;
    const auto* bytes = reinterpret_cast<const uint8_t*>(field);
    f.bytes.assign(bytes, bytes + per_world * sizeof(T) * shot.n_worlds);
    shot.fields.push_back(std::move(f));
  });
  for (const Output& output : outputs_) {
    SnapshotField f = output.shape;
    f.bytes = output.buffer.to_host();
    shot.fields.push_back(std::move(f));
  }
  return shot;
}

void Activity::add(const Snapshot& snapshot) {
  const SnapshotField& detected = snapshot.field("detected");
  for (size_t k = 0; k < detected.bytes.size() / 4; ++k) detections += read<uint32_t>(detected, k) != 0;
  for (const uint8_t count : snapshot.field("tracked").bytes) shots += count != 0;
  for (const uint8_t alive : snapshot.field("alive").bytes) dead += alive == 0;
  const SnapshotField& length = snapshot.field("episode_length");
  for (size_t w = 0; w < snapshot.n_worlds; ++w) {
    ended += read<int32_t>(length, w) == 0 || snapshot.byte_at("phase", w) != 0;
    waypoints += snapshot.float_at("waypoint_time", w) > 0;
  }
}

}  // namespace giga::test
