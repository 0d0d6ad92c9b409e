#include "eval/record.hpp"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <limits>
#include <optional>

#include "cuda/runtime.hpp"
#include "eval/recorded_world.hpp"
#include "game/game.hpp"
#include "learn/players/player.hpp"
#include "learn/players/value_function.hpp"
#include "policy/actor.hpp"
#include "rollout/policy_controllers.hpp"
#include "rollout/stream.hpp"
#include "scenario/compile.hpp"
#include "scenario/loader.hpp"
#include "sim/physics.hpp"

namespace giga {
namespace {

/// JSON has no infinity, and no map is as large as this.
float finite(float value) { return std::min(value, 1e9f); }

ReplayRules rules_of(const Scenario& scenario, const SimSpec& spec) {
  const SimParams& p = spec.params;
  ReplayRules r;
  r.limit_x = p.limit_x;
  r.limit_y = p.limit_y;
  r.limit_z = kAltitudeLimit;
  r.seconds_per_step = kDt;
  r.max_episode_length = p.max_episode_length;
  r.close_depth = finite(scenario.sight.very_close_cone_depth);
  r.sight_depth = finite(scenario.sight.cone_depth);
  r.sight_angle = finite(scenario.sight.cone_angle);
  r.weapon_depth = finite(scenario.damage.damage_cone_depth);
  r.weapon_angle = finite(scenario.damage.damage_cone_angle);
  r.hearing_range = p.stochastic_communication ? finite(p.communication_range) : 0;
  r.min_tracking_time = p.min_tracking_time;
  r.max_tracking_time = p.max_tracking_time;
  r.waypoints = p.waypoints;
  r.obstacle_heights = p.obstacle_heights;
  r.health_unit = health_unit(most_health(spec));
  return r;
}

std::vector<ReplayAgent> agents_of(const Scenario& scenario, const SimSpec& spec) {
  std::vector<ReplayAgent> agents;
  std::vector<std::string> kinds;
  for (const auto* team : {&scenario.team_0, &scenario.team_1})
    for (const TeamEntry& entry : *team) kinds.insert(kinds.end(), static_cast<size_t>(entry.count), entry.type);
  for (size_t i = 0; i < spec.agents.size(); ++i) {
    const AgentSpec& a = spec.agents[i];
    const std::string kind = i < kinds.size() ? kinds[i] : "";
    agents.push_back({a.team, kind, a.sprite, a.max_health, finite(a.range), finite(a.damage_range), finite(a.thrust)});
  }
  return agents;
}

std::vector<ReplayMap> maps_of(const SimSpec& spec) {
  std::vector<ReplayMap> maps;
  for (const MapSpec& map : spec.maps) {
    maps.push_back({map.name, {}});
    for (const Box& b : map.boxes) {
      const float top = spec.params.obstacle_heights ? b.z2 : kAltitudeLimit;
      maps.back().boxes.push_back({b.x1, b.y1, b.x2, b.y2, spec.params.obstacle_heights ? b.z1 : 0.0f, top});
    }
  }
  return maps;
}

/// Plays the actions of a side of a replay.
class ReplayedTeam final : public TeamController {
 public:
  explicit ReplayedTeam(const Replay& replay) : replay_(replay) {}

  ObservationSet reads() const override { return {}; }
  void act(std::span<const TeamStep> parts) override {
    for (const TeamStep& part : parts) act(part);
  }

 private:
  void act(const TeamStep& s) const {
    const bool discrete = replay_.actions == ReplayActions::discrete;
    const size_t size = discrete ? sizeof(int32_t) : kActionSize * sizeof(float);
    std::vector<uint8_t> bytes(static_cast<size_t>(s.n_rows()) * size);
    uint8_t* to = bytes.data();
    for (int64_t w = s.worlds.first; w < s.worlds.end(); ++w) {
      const ReplayEpisode& e = replay_.episodes[static_cast<size_t>(w)];
      for (int i = 0; i < s.n(); ++i, to += size) {
        if (s.number >= e.steps) continue;  // the world waits
        const int agent = i + (s.team == 0 ? 0 : replay_.n_team(0));
        const auto at = static_cast<size_t>(int64_t{agent} * e.steps + s.number);
        const int32_t index = discrete ? e.action[at] : 0;
        std::memcpy(to, discrete ? static_cast<const void*>(&index) : e.action.data() + at * size, size);
      }
    }
    s.sim.memory().from_host(s.buffers.action, bytes.data(), bytes.size());
  }

  const Replay& replay_;
};

uint64_t seed_of_digits(const Replay& replay) {
  uint64_t seed = 0;
  const char* end = replay.seed.data() + replay.seed.size();
  const auto [at, error] = std::from_chars(replay.seed.data(), end, seed);
  if (error != std::errc() || at != end) throw InputError(cat("the seed of the replay is ", replay.seed));
  return seed;
}

/// What a replay says of an episode beside its states; empty: what both say is the same.
std::string other_difference(const ReplayEpisode& a, const ReplayEpisode& b) {
  const auto same_event = [](const ReplayEvent& x, const ReplayEvent& y) {
    return x.step == y.step && x.what == y.what && x.agent == y.agent && x.other == y.other;
  };
  const auto same_waypoint = [](const ReplayWaypoint& x, const ReplayWaypoint& y) {
    return x.from == y.from && x.to == y.to && x.x1 == y.x1 && x.y1 == y.y1 && x.x2 == y.x2 && x.y2 == y.y2;
  };
  if (a.map != b.map) return "in its map";
  if (a.start != b.start) return "in how it starts";
  if (a.winner != b.winner || a.at_time_limit != b.at_time_limit) return "in who wins";
  if (a.score != b.score || a.returns != b.returns) return "in its scores or returns";
  if (a.died != b.died || a.cause != b.cause) return "in who dies";
  if (a.sees != b.sees) return a.fires.empty() ? "in who is seen" : "in who detects whom";
  if (a.fires != b.fires || a.fire != b.fire) return "in who shoots at whom";
  if (a.hears != b.hears) return "in who hears whom";
  if (!std::equal(a.events.begin(), a.events.end(), b.events.begin(), b.events.end(), same_event))
    return "in its events";
  if (!std::equal(a.waypoints.begin(), a.waypoints.end(), b.waypoints.begin(), b.waypoints.end(), same_waypoint))
    return "in its waypoints";
  return "";
}

/// The first state of an agent's column that differs; `states` where none does.
int first_difference(const ReplayEpisode& a, const ReplayEpisode& b, int states) {
  int first = states;
  for (const auto column : {&ReplayEpisode::x, &ReplayEpisode::y, &ReplayEpisode::z, &ReplayEpisode::heading,
                            &ReplayEpisode::speed, &ReplayEpisode::health}) {
    const auto &left = a.*column, &right = b.*column;
    for (size_t k = 0; k < left.size(); ++k)
      if (left[k] != right[k]) first = std::min(first, static_cast<int>(k % static_cast<size_t>(states)));
  }
  return first;
}

}  // namespace

Replay replay_frame(const Scenario& scenario, const SimSpec& spec, const std::string& version) {
  Replay replay;
  replay.gigastep_version = version;
  replay.scenario_name = spec.name;
  replay.scenario = print_yaml(scenario, false);
  replay.actions = static_cast<ReplayActions>(spec.params.actions);
  replay.rules = rules_of(scenario, spec);
  replay.flight = {Physics::turn_rate, Physics::climb_rate,   Physics::thrust,
                   Physics::drag,      Physics::half_gravity, Physics::min_speed};
  replay.agents = agents_of(scenario, spec);
  replay.maps = maps_of(spec);
  return replay;
}

RecordedMatch record_match(const Scenario& scenario, const SimSpec& spec,
                           const std::array<RecordedTeam, kNTeams>& teams, const MatchOptions& options,
                           const std::string& version) {
  RecordedMatch recorded{replay_frame(scenario, spec, version), {}};
  Replay& replay = recorded.replay;
  replay.seed = cat(options.seed);
  replay.players = {teams[0].name, teams[1].name};
  replay.origins = {teams[0].origin, teams[1].origin};

  const int most_steps = spec.with_time_limit().params.max_episode_length;
  if (const std::string wrong = too_large_to_keep(replay, options.episodes, most_steps); !wrong.empty())
    throw InputError(wrong);
  Recorder recorder(spec, {teams[0].mind, teams[1].mind});
  recorded.result = play_match(spec, teams[0].controller, teams[1].controller, options, {&recorder});
  replay.episodes = recorder.episodes(replay.seed);
  return recorded;
}

TeamRecording::TeamRecording(const LoadedRun& run, Learner& learner, int episodes, const MatchOptions& options)
    : run_(run), seed_(options.seed) {
  NamedArrays critics;
  learner.save_critics(critics);
  Minds minds;
  games_.episodes = episodes;
  for (int team = 0; team < kNTeams; ++team) {
    const auto side = static_cast<size_t>(team);
    if (const Actor* actor = learner.actor(team)) {
      values_[team] = ValueFunction::load(run, team, critics, *actor, options.device);
      names_[side] = cat("team ", team, " after ", learner.updates_done(), " ", algorithm_of(run.config).updates);
      games_.pair.side[side] = policy_controller(*actor, acts_greedily(run.config));
      minds[side] = {actor, values_[team].get()};
    } else {
      Player* opponent = learner.opponent();  // its file may have changed since
      if (!opponent) {
        script_ = std::make_unique<Player>(Player::load(run.config.train.opponent.name, {.device = options.device}));
        opponent = script_.get();
      }
      names_[side] = opponent->name();
      games_.pair.side[side] = opponent->controller(team, run.spec);
      minds[side] = opponent->mind(team, run.spec);
    }
    // Images of all worlds would be drawn for these few, and replays need tables of pairs.
    const Mind& mind = minds[side];
    if ((mind.policy && mind.policy->reads_image()) || (mind.values && mind.values->reads_image())) games_.alone = true;
  }
  // A CPU takes as long for them beside others as alone, and there one thread is enough.
  if (finds_by_place(run.spec, {.pairs = options.pairs}) || !options.device.is_cuda()) games_.alone = true;
  recorder_ = std::make_unique<Recorder>(run.spec, minds, RecorderOptions{.worlds = episodes});
  games_.observer = recorder_.get();
}

TeamRecording::~TeamRecording() = default;

void TeamRecording::finish() {
  recorder_->finish();
  for (std::unique_ptr<ValueFunction>& values : values_) values.reset();
}

void TeamRecording::fill() { recorder_->fill(); }

Replay TeamRecording::replay(const std::string& version) {
  Replay replay = replay_frame(run_.scenario, run_.spec, version);
  replay.seed = cat(seed_);
  replay.players = names_;
  replay.episodes = recorder_->episodes(replay.seed);
  return replay;
}

std::string verify_replay(const Replay& replay, Device device) {
  const Scenario scenario = parse_scenario(replay.scenario, "the scenario of the replay", {});
  const SimSpec spec = compile(scenario).with_time_limit();
  if (spec.params.n_agents != replay.n_agents() || spec.params.n_team[0] != replay.n_team(0))
    throw InputError(
        cat("the scenario of the replay has ", spec.params.n_agents, " agents, its games have ", replay.n_agents()));
  if (static_cast<ReplayActions>(spec.params.actions) != replay.actions)
    throw InputError("the scenario of the replay has other actions than its games");
  if (replay.episodes.empty()) return "";

  SimOptions options;
  options.n_worlds = static_cast<int>(replay.episodes.size());
  options.seed = seed_of_digits(replay);
  options.on_done = OnDone::freeze;
  options.pairs = Pairs::tables;
  options.n_threads = replay.is_crowd() ? 0 : 1;  // the agents of a crowd are shared among threads
  void* const stream = current_stream(device);
  const auto sim = make_simulator(spec, options, device, stream);
  const ParallelFor parallel_for(device, 1, stream);
  const auto team = std::make_shared<ReplayedTeam>(replay);
  Recorder recorder(spec);
  Game game(*sim, parallel_for, {everywhere(team, *sim), everywhere(team, *sim)}, {&recorder});
  game.start();
  game.play(spec.params.max_episode_length);

  const std::vector<ReplayEpisode> again = recorder.episodes(replay.seed);
  for (size_t k = 0; k < again.size(); ++k) {
    const ReplayEpisode &now = again[k], &then = replay.episodes[k];
    if (now.steps != then.steps) return cat("episode ", k, " ends after ", now.steps, " steps, not ", then.steps);
    if (const int at = first_difference(now, then, then.steps + 1); at <= then.steps)
      return cat("episode ", k, " differs from step ", at, " on");
    if (now.state_check != then.state_check)
      return cat("episode ", k, " differs by less than the replay keeps: the checksums of its states are ",
                 now.state_check, " now, ", then.state_check, " then");
    if (const std::string what = other_difference(now, then); !what.empty())
      return cat("episode ", k, " has the same states, but differs ", what);
  }
  return "";
}

}  // namespace giga
