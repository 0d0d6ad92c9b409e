// Buffers and poison of TestWorld.
#include "support/sim_world.hpp"

#include <algorithm>
#include <cstring>
#include <limits>

namespace giga::test {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr uint8_t kPoison = 0xFF;

SimSpec finished(SimSpec spec) {
  spec.finish();
  return spec;
}

bool all_poison(const float* begin, size_t count) {
  return std::all_of(begin, begin + count, [](float v) { return v != v; });
}

}  // namespace

TestWorld::TestWorld(SimSpec spec, OnDone on_done)
    : tables_(finished(std::move(spec)), host_memory()),
      state_(tables_.params().n_agents, kNWorlds, host_memory()),
      on_done_(on_done),
      layout_(tables_.params()),
      scratch_(host_memory(), layout_.size) {
  std::vector<uint8_t> bytes(state_.save().size(), kPoison);
  state_.load(bytes);
  const StateView& s = state_.view();
  view_ = world_view(s, params().n_agents, kWorld);
  *view_.draw_step = 0;
  *view_.phase = Phase::plays;
  attach_scratch(view_, layout_, scratch_.data());
  ObservationSet offered;
  for_each_observation([&](auto kind) {
    if (kind.of == ObservationOf::agent && kind.type == ElementType::f32 && kind.offered(params())) offered |= kind.id;
  });
  rows_ = RowLayout(params(), offered);
  done_.resize(kNWorlds);
  true_state_.resize(kNWorlds * state_columns());
  final_state_ = true_state_;
  terms_.resize(kNWorlds * static_cast<size_t>(kNRewardTerms * n_agents()));
  io_.done = done_.data();
  io_.world[Observation::state] = {true_state_.data(), final_state_.data()};
  io_.terms = terms_.data();
  for (int t = 0; t < kNTeams; ++t) {
    Team& team = teams_[t];
    const size_t rows = kNWorlds * static_cast<size_t>(params().n_team[t]);
    team.indices.assign(rows, 13);
    team.controls.assign(rows * kActionSize, 0.0f);
    team.obs.resize(rows * stride());
    team.final_obs.resize(rows * stride());
    team.reward.resize(rows);
    team.alive.resize(rows);
    team.final_alive.resize(rows);
    const bool discrete = params().actions == ActionKind::discrete;
    io_.team[t].action = discrete ? static_cast<const void*>(team.indices.data()) : team.controls.data();
    rows_.attach(io_.team[t], rows_.set(), team.obs.data(), team.final_obs.data());
    io_.team[t].reward = team.reward.data();
    io_.team[t].alive = team.alive.data();
    io_.team[t].final_alive = team.final_alive.data();
    team.mirrored.assign(kNWorlds, 0);
    io_.team[t].mirrored = team.mirrored.data();
  }
  start();
}

void TestWorld::poison() {
  std::memset(scratch_.data(), kPoison, scratch_.size());
  for (Team& team : teams_) {
    for (auto* out : {&team.obs, &team.final_obs, &team.reward}) std::fill(out->begin(), out->end(), kNan);
    for (auto* out : {&team.alive, &team.final_alive}) std::fill(out->begin(), out->end(), kPoison);
  }
  std::fill(done_.begin(), done_.end(), kPoison);
  for (auto* out : {&true_state_, &final_state_, &terms_}) std::fill(out->begin(), out->end(), kNan);
}

void TestWorld::start() {
  poison();
  run(jobs_of_start(io_));
}

void TestWorld::step() {
  poison();
  run(jobs_of_step({on_done_}, io_));
}

void TestWorld::run(const Jobs& jobs) {
  const auto draws_at = [this](uint32_t) -> FixedDraws& { return draws; };
  run_jobs(SerialLanes{}, jobs, params(), view_, draws_at, io_, {on_done_}, kWorld);
}

void TestWorld::put(int i, float x, float y, float heading, float z, float v) {
  view_.x[i] = x;
  view_.y[i] = y;
  view_.heading[i] = heading;
  view_.z[i] = z;
  view_.v[i] = v;
}

void TestWorld::kill(int i) {
  view_.alive[i] = 0;
  view_.death[i] = Death::damage;
  view_.health[i] = 0;
}

void TestWorld::control(int i, float heading, float dive, float throttle) {
  float* c = teams_[team(i)].controls.data() + row(i) * kActionSize;
  c[0] = heading;
  c[1] = dive;
  c[2] = throttle;
}

void TestWorld::mirror(int team, bool mirrored) { teams_[team].mirrored[kWorld] = mirrored; }

void TestWorld::act(int i, int action) { teams_[team(i)].indices[row(i)] = action; }

float TestWorld::term(RewardTerm t, int i) const {
  return terms_[(kWorld * kNRewardTerms + static_cast<size_t>(t)) * static_cast<size_t>(n_agents()) +
                static_cast<size_t>(i)];
}

bool TestWorld::neighbors_untouched() const {
  bool untouched = done_[0] == kPoison && done_[2] == kPoison;
  const auto check = [&untouched](const std::vector<float>& out) {
    const size_t per_world = out.size() / kNWorlds;
    untouched = untouched && all_poison(out.data(), per_world) && all_poison(out.data() + 2 * per_world, per_world);
  };
  for (const Team& team : teams_)
    for (const auto* out : {&team.obs, &team.final_obs, &team.reward}) check(*out);
  for (const auto* out : {&true_state_, &final_state_, &terms_}) check(*out);
  const StateView& s = state_.view();
  for_each_field([&](auto field, auto member) {
    const auto* array = s.*member;
    const auto* bytes = reinterpret_cast<const uint8_t*>(array);
    const size_t size = static_cast<size_t>(field.count(n_agents())) * sizeof(*array);
    for (size_t k = 0; k < size; ++k) untouched = untouched && bytes[k] == kPoison && bytes[2 * size + k] == kPoison;
  });
  return untouched;
}

}  // namespace giga::test
