#include "play/session.hpp"

#include <utility>
#include <vector>

#include "core/fnv1a.hpp"
#include "math/distributions.hpp"

namespace giga {
namespace {

class PlainController final : public TeamController {
 public:
  explicit PlainController(std::shared_ptr<const PlainNetwork> network) : network_(std::move(network)) {}

  ObservationSet reads() const override { return all_numbers(); }
  int64_t memory_size() const override { return static_cast<int64_t>(network_->memory.state_size()); }
  void act(std::span<const TeamStep> parts) override {
    for (const TeamStep& part : parts) act(part);
  }

 private:
  void act(const TeamStep& s) {
    const bool discrete = s.sim.params().actions == ActionKind::discrete;
    const int64_t stride = discrete ? kLogitStride : kActionSize;
    heads_.assign(static_cast<size_t>((s.n_rows() * stride + 3) / 4), Quad{});
    float* heads = heads_[0].v;
    const TeamBuffers& b = s.buffers;
    for (int64_t row = 0; row < s.n_rows(); ++row)
      network_->forward(b.obs + row * s.obs_stride(), b.memory + row * b.memory_size, heads + row * stride);
    if (discrete)
      s.parallel_for.run(
          SampleCategorical{heads, s.draws(), static_cast<int32_t*>(b.action), nullptr, network_->greedy}, s.n_rows());
    else
      s.parallel_for.run(SampleGaussian{heads, network_->log_std.data(), s.draws(), nullptr,
                                        static_cast<float*>(b.action), nullptr, network_->greedy},
                         s.n_rows());
  }

  const std::shared_ptr<const PlainNetwork> network_;
  std::vector<Quad> heads_;  // aligned as rows of logits are
};

/// A team of whose agents a person flies one. The others are flown as if it were one of theirs.
class TeamWithPerson final : public TeamController {
 public:
  TeamWithPerson(std::unique_ptr<TeamController> mates, int slot, std::shared_ptr<const Controls> controls)
      : mates_(std::move(mates)), slot_(slot), controls_(std::move(controls)) {}

  ObservationSet reads() const override { return mates_->reads(); }
  int64_t memory_size() const override { return mates_->memory_size(); }
  void act(std::span<const TeamStep> parts) override {
    mates_->act(parts);
    for (const TeamStep& part : parts) {
      if (part.sim.params().actions == ActionKind::discrete) {
        static_cast<int32_t*>(part.buffers.action)[slot_] = discrete_action(*controls_);
        continue;
      }
      float* action = static_cast<float*>(part.buffers.action) + slot_ * kActionSize;
      action[0] = controls_->heading;
      action[1] = controls_->dive;
      action[2] = controls_->throttle;
    }
  }

 private:
  const std::unique_ptr<TeamController> mates_;
  const int slot_;
  const std::shared_ptr<const Controls> controls_;
};

std::unique_ptr<TeamController> controller_of(const PlayTeam& team) {
  return team.network ? plain_controller(team.network) : script_controller(team.script);
}

SimOptions options_of(uint64_t seed, OnDone on_done) {
  SimOptions options;
  options.seed = seed;
  options.on_done = on_done;
  options.n_threads = 1;
  return options;
}

}  // namespace

std::unique_ptr<TeamController> plain_controller(std::shared_ptr<const PlainNetwork> network) {
  return std::make_unique<PlainController>(std::move(network));
}

/// Notes where the actions of a step lie.
class PlaySession::Actions final : public GameObserver {
 public:
  explicit Actions(std::array<const void*, kNTeams>& to) : to_(to) {}
  void after_step(int64_t t, const GameStep& step) override {
    if (t < 0) return;
    for (size_t team = 0; team < kNTeams; ++team) to_[team] = step.team[team].action;
  }

 private:
  std::array<const void*, kNTeams>& to_;
};

PlaySession::PlaySession(const SimSpec& spec, uint64_t seed, const PlayTeam& team_0, const PlayTeam& team_1, int person)
    : sim_(make_cpu_simulator(spec.with_time_limit(), options_of(seed, OnDone::freeze))),
      parallel_for_(Device{}, 1),
      controls_(std::make_shared<Controls>(Controls{0, 0, 0})),
      watcher_(std::make_unique<Actions>(actions_)) {
  const SimParams& p = spec.params;
  GIGA_CHECK(person >= -1 && person < p.n_agents, "agent ", person, " of ", p.n_agents);
  BothSides sides;
  for (int team = 0; team < kNTeams; ++team) {
    std::unique_ptr<TeamController> controller = controller_of(team == 0 ? team_0 : team_1);
    if (person >= 0 && p.team_of(person) == team)
      controller = std::make_unique<TeamWithPerson>(std::move(controller), p.slot_of(person), controls_);
    sides[static_cast<size_t>(team)] = everywhere(std::move(controller), *sim_);
  }
  game_ = std::make_unique<Game>(*sim_, parallel_for_, sides, std::vector<GameObserver*>{watcher_.get()});
  game_->start();
}

PlaySession::~PlaySession() = default;

void PlaySession::step(const Controls& controls) {
  *controls_ = controls;
  game_->play(1);
}

uint64_t states_hash(const SimSpec& spec, int steps) {
  const auto make = spec.params.n_agents > kMaxAgents ? make_grid_simulator : make_cpu_simulator;
  const auto sim = make(spec, options_of(1, OnDone::reset));
  const ParallelFor parallel_for(Device{}, 1);
  const std::shared_ptr<TeamController> team = script_controller(Scripted::random);
  Game game(*sim, parallel_for, {everywhere(team, *sim), everywhere(team, *sim)});
  game.start();
  Fnv1a hash;
  for (int step = 0; step < steps; ++step) {
    game.play(1);
    if (step % 16 != 15 && step + 1 != steps) continue;
    hash.add_all(sim->state().save());
  }
  return hash.value();
}

}  // namespace giga
