// What MAPPO allows in a config, and when a run goes on.
#include "learn/mappo/config.hpp"

#include <algorithm>
#include <numeric>

#include "core/error.hpp"
#include "learn/alike_teams.hpp"
#include "learn/config_check.hpp"
#include "learn/opponents/world_shares.hpp"
#include "sim/image_state.hpp"
#include "sim/row_layout.hpp"
#include "sim/simulator.hpp"

namespace giga {
namespace {

constexpr ResumeRule kMappoMayChange[] = {
    {"mappo.learning_rate", "from here on, as all below"},
    {"mappo.critic_learning_rate", ""},
    {"mappo.schedule", ""},
    {"mappo.final_learning_rate_factor", ""},
    {"mappo.clip_coef", ""},
    {"mappo.entropy_rate", ""},
    {"mappo.entropy_coef", "without entropy_target"},
    {"mappo.max_grad_norm", ""},
    {"mappo.target_kl", ""},
    {"mappo.n_epochs", ""},
    {"mappo.shards", ""},
    {"mappo.shaping_fade_start", ""},
    {"mappo.shaping_fade_end", ""},
    {"mappo.team_learning_rate_factors", ""},
    {"mappo.graphs", ""},
};
constexpr ResumeRule kMappoMayNot[] = {
    {"mappo.entropy_target", "metrics.csv has columns for it"},
    {"mappo.final_gamma", "metrics.csv has a column for it"},
    {"mappo.final_clip_coef", "metrics.csv has a column for it"},
    {"mappo.final_entropy_coef", "metrics.csv has a column for it"},
    {"mappo.shaping_final_factor", "metrics.csv has a column for it"},
    {"mappo.shaping_final_factors.", "metrics.csv has columns for them"},
    {"mappo.freeze_lead", "metrics.csv has columns for it"},
    {"mappo.step_back", "metrics.csv has columns for it"},
    {"mappo.view_coef", "what it teaches is saved with it, and metrics.csv has columns for it"},
    {"mappo.horizon", "the count of agent-steps done rests on it"},
    {"mappo.actor.", "the saved parameters fit their networks only"},
    {"mappo.critic.", "the saved parameters fit their networks only"},
    {"mappo.value_norm", "the saved values are in the units of their normaliser"},
    {"mappo.obs_norm", "the saved policies expect their observations so"},
    {"mappo.one_policy", "the saved optimizer steps are those of one policy, or of two"},
};

constexpr ChartRow kMappoCharts[] = {
    {"entropy", "Entropy", "of the policy, nats"},
    {"approx_kl", "Approximate KL", "of the policy before an update and before its last step, nats"},
    {"explained_variance", "Explained variance", "of the returns by the critic; 1 = all of it"},
    {"clip_fraction", "Clip fraction", "share of probability ratios beyond the clip range"},
    {"policy_loss", "Policy loss", "the clipped surrogate; its size says little, its jumps do"},
    {"value_loss", "Value loss", "of the critic, in normalised units"},
};
constexpr std::string_view kMappoUnread[] = {"population.", "openai_es.", "snes.", "des."};

/// The network whose encoder gives the critic its features.
const NetworkConfig& encodes_for_critic(const MappoConfig& c) {
  if (c.critic.shared_encoder) return c.actor;
  return c.critic;
}

/// A critic on the features of the actor's encoder has none of its own, and nothing of its own to read.
void encoder_is_shared(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (c.critic.kind == CriticKind::state) {
    if (check.known({"mappo.critic.kind"}))
      check.fail("mappo.critic.shared_encoder",
                 "the actor's encoder reads what an agent is given, and mappo.critic.kind state the true state of the "
                 "world; allowed with it: false");
  } else if (c.critic.reads_image() && check.known({"mappo.critic.encoder"})) {
    check.fail("mappo.critic.encoder",
               cat("'", FieldCodec<EncoderKind>::print(c.critic.encoder),
                   "' would be an encoder of the critic's own, and mappo.critic.shared_encoder: true gives it the "
                   "actor's; allowed with it: mlp, which are layers on the features"));
  } else if (c.critic.inputs != c.actor.inputs && check.known({"mappo.actor.inputs", "mappo.critic.inputs"})) {
    const std::string read = FieldCodec<NetworkInputs>::print(c.actor.inputs);
    check.fail(
        "mappo.critic.inputs",
        cat("'", FieldCodec<NetworkInputs>::print(c.critic.inputs), "' is not what mappo.actor.inputs says, '", read,
            "', and mappo.critic.shared_encoder: true gives it the actor's encoder; allowed with it: ", read));
  }
}

/// What a critic with an encoder of its own reads is given to the agents; one of the true state reads nothing of
/// theirs.
void critic_sees(ConfigCheck& check) {
  const CriticConfig& critic = check.config.mappo.critic;
  if (critic.kind != CriticKind::state) return check.inputs_are_there("mappo.critic", critic);
  if (critic.reads_image() && check.known({"mappo.critic.encoder", "mappo.critic.kind"}))
    check.fail("mappo.critic.encoder",
               cat("'", FieldCodec<EncoderKind>::print(critic.encoder),
                   "' reads images, and mappo.critic.kind state the true state of the world, which is numbers; allowed "
                   "with it: mlp"));
}

void networks_see(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  check.inputs_are_there("mappo.actor", c.actor);
  check.log_std_fits("mappo.actor", c.actor);
  if (c.critic.shared_encoder)
    encoder_is_shared(check);
  else if (check.known({"mappo.critic.shared_encoder"}))
    critic_sees(check);
  if (c.obs_norm && c.actor.reads_image() && check.known({"mappo.obs_norm", "mappo.actor.encoder"}))
    check.fail("mappo.obs_norm",
               cat("this normalises the numbers that actors read, and mappo.actor.encoder ",
                   FieldCodec<EncoderKind>::print(c.actor.encoder), " reads images; allowed with it: false"));
}

/// The egocentric view is given to the agents, and the actor has an encoder that does not read it.
void view_is_taught(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (c.view_coef == 0 || !check.known({"mappo.view_coef", "mappo.actor.encoder"})) return;
  if (!c.actor.reads_image())
    return check.fail("mappo.view_coef",
                      cat(c.view_coef, ": this teaches an encoder of images, and mappo.actor.encoder ",
                          FieldCodec<EncoderKind>::print(c.actor.encoder), " reads numbers; allowed with it: 0"));
  if (check.spec && check.scenario_knows("observation.type") && check.spec->params.images_only)
    return check.fail("mappo.view_coef",
                      cat(c.view_coef, ": agents of '", check.config.scenario,
                          "' are given images alone (observation.type: rgb), and this teaches what numbers tell; "
                          "rgb_vector gives both; allowed with rgb: 0"));
  if (check.spec && check.scenario_knows("observation.egocentric_view") && !check.spec->params.egocentric_view)
    check.fail("mappo.view_coef", cat(c.view_coef,
                                      ": this teaches the egocentric view, and environment.observation.egocentric_view "
                                      "is false; allowed with it: 0"));
}

/// The mirror shows egocentric views, and nothing else that networks read.
void mirror_shows_all(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (!c.mirror || check.config.train.opponent.is_path() || !check.known({"mappo.mirror"})) return;
  const auto reads_the_view_alone = [&](const std::string& group, const NetworkConfig& network) {
    const std::string encoder = group + ".encoder", inputs = group + ".inputs";
    if (!check.known({encoder, inputs})) return;
    const auto refuse = [&](const std::string& key, const std::string& value) {
      check.fail("mappo.mirror", cat("true, and ", key, " '", value,
                                     "' reads what the mirror does not show, which shows the egocentric view; allowed "
                                     "with it: false"));
    };
    if (network.reads_image())
      refuse(encoder, FieldCodec<EncoderKind>::print(network.encoder));
    else if (network.inputs != NetworkInputs::egocentric)
      refuse(inputs, FieldCodec<NetworkInputs>::print(network.inputs));
  };
  reads_the_view_alone("mappo.actor", c.actor);
  if (!c.critic.shared_encoder && check.known({"mappo.critic.kind", "mappo.critic.shared_encoder"}) &&
      c.critic.kind != CriticKind::state)
    reads_the_view_alone("mappo.critic", c.critic);
}

/// One policy for both teams leaves neither of them behind.
void no_team_rests(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (!check.spec || !check.known({"mappo.one_policy", "train.opponent"})) return;
  for (const char* key : {"team_0", "team_1", "agent_types", "win"})
    if (!check.scenario_knows(key)) return;
  if (!has_one_policy(check.config, *check.spec)) return;
  const auto refuse = [&](const char* key, bool is_set) {
    if (is_set && check.known({key}))
      check.fail(key, "this is for the policy of one team, and both play by one; allowed with mappo.one_policy: none");
  };
  refuse("mappo.freeze_lead", c.freeze_lead.has_value());
  refuse("mappo.step_back", c.step_back.has_value());
  const auto& [factor_0, factor_1] = c.team_learning_rate_factors;
  if (factor_0 != factor_1 && check.known({"mappo.team_learning_rate_factors"}))
    check.fail("mappo.team_learning_rate_factors",
               "both teams play by one policy (mappo.one_policy); allowed with it: two that are equal");
}

/// A rollout of one step has nothing that a memory could learn from.
void memory_has_steps(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (c.horizon > 1 || !check.known({"mappo.horizon"})) return;
  const auto refuse = [&](const char* key, const NetworkConfig& network) {
    if (network.remembers() && check.known({key}))
      check.fail(key,
                 cat("'", FieldCodec<MemoryKind>::print(network.memory),
                     "' learns from the steps of a rollout in a row, and mappo.horizon is 1; allowed with it: none; "
                     "with memory mappo.horizon is at least 2"));
  };
  refuse("mappo.actor.memory", c.actor);
  refuse("mappo.critic.memory", c.critic);
}

void minibatches_divide(ConfigCheck& check) {
  if (!check.known(
          {"train.n_worlds", "mappo.horizon", "mappo.n_minibatches", "mappo.actor.memory", "mappo.critic.memory"}))
    return;
  const TrainConfig& train = check.config.train;
  const MappoConfig& c = check.config.mappo;
  if (c.shards > 1) return;  // shards_divide
  const bool whole = steps_together(c) > 1;
  const int64_t states = static_cast<int64_t>(train.n_worlds) * c.horizon / steps_together(c);
  if (states % c.n_minibatches == 0) return;
  // The divisors around it, which are what is allowed.
  int64_t below = std::min<int64_t>(c.n_minibatches, states), above = below;
  while (states % below != 0) --below;
  while (above <= states && states % above != 0) ++above;
  const std::string nearest = above > c.n_minibatches && above <= states ? cat(below, ", ", above) : cat(below);
  if (whole)
    return check.fail("mappo.n_minibatches", cat(c.n_minibatches, " does not divide train.n_worlds = ", train.n_worlds,
                                                 ", whose rollouts stay whole with memory; nearest: ", nearest));
  check.fail("mappo.n_minibatches", cat(c.n_minibatches, " does not divide train.n_worlds x mappo.horizon = ",
                                        train.n_worlds, " x ", c.horizon, " = ", states, "; nearest: ", nearest));
}

/// Each shard has as many worlds, and gives each minibatch as many states.
void shards_divide(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (c.shards == 1 || !check.known({"mappo.shards", "train.n_worlds"})) return;
  const int64_t n_worlds = check.config.train.n_worlds;
  if (n_worlds % c.shards != 0)
    return check.fail("mappo.shards", cat(c.shards, " does not divide train.n_worlds = ", n_worlds));
  if (!check.known({"mappo.horizon", "mappo.n_minibatches", "mappo.actor.memory", "mappo.critic.memory",
                    "opponents.pool_size", "opponents.pool_share", "opponents.scripted_share"}))
    return;
  const WorldShares shares = world_shares(check.config.opponents, n_worlds, c.shards);
  const ShardRange learning = shares.learning(0);
  const int64_t states = learning.in_shard.count * (c.horizon / steps_together(c));
  const std::string of_a_shard = cat(states, steps_together(c) > 1 ? " worlds" : " states", " of a shard"),
                    sizes = cat(" (train.n_worlds ", n_worlds, ", mappo.shards ", c.shards, ")");
  if (learning.everywhere() && states % c.n_minibatches != 0)
    check.fail("mappo.n_minibatches", cat(c.n_minibatches, " does not divide the ", of_a_shard, sizes));
  if (!learning.everywhere() && states < c.n_minibatches)  // else the few that are left over are left out
    check.fail("mappo.n_minibatches", cat(c.n_minibatches, " minibatches for the ", of_a_shard,
                                          " that a team learns from (opponents)", sizes));
}

/// Shares that come to no world.
void worlds_suffice(ConfigCheck& check) {
  const OpponentsConfig& p = check.config.opponents;
  const MappoConfig& c = check.config.mappo;
  const int n_worlds = check.config.train.n_worlds;
  if (!check.config.train.opponent.is_self_play()) return;
  if (p.pool_size > 0 && p.pool_share + p.scripted_share > 1) return;
  if (n_worlds % c.shards != 0) return;  // shards_divide
  const WorldShares shares = world_shares(p, n_worlds, c.shards);
  const std::string where = c.shards > 1 ? cat(" in each of mappo.shards ", c.shards) : "";
  const auto too_few = [&](const char* key, float share, int64_t worlds, int64_t needed, const char* what) {
    if (worlds < needed && check.known({key, "train.n_worlds"}))
      check.fail(key, cat(share, " of train.n_worlds ", n_worlds, " leaves each team ", worlds, " worlds", where,
                          " against ", what, "; it needs at least ", needed));
  };
  if (p.pool_size > 0 && p.pool_share > 0)
    too_few("opponents.pool_share", p.pool_share, shares.pooled(), 1, "the pool");
  if (p.scripted_share > 0 && check.known({"opponents.scripted"}))
    too_few("opponents.scripted_share", p.scripted_share, shares.scripted, static_cast<int64_t>(p.scripted.size()),
            "scripts (opponents.scripted)");
  if (c.freeze_lead && shares.self_play().count() == 0 && !check.has_begun &&
      check.known({"mappo.freeze_lead", "train.n_worlds"}))
    check.fail("mappo.freeze_lead",
               cat("it goes by games between the learning teams, and opponents.pool_share ", p.pool_share,
                   " and opponents.scripted_share ", p.scripted_share, " leave no world of ", n_worlds, " for them"));
  const int64_t states = shares.learning(0).count() * c.horizon / steps_together(c);
  if (states < c.n_minibatches && check.known({"train.n_worlds", "mappo.horizon", "mappo.n_minibatches"}))
    check.fail("mappo.n_minibatches",
               cat(c.n_minibatches, " minibatches for ", states,
                   steps_together(c) > 1 ? " worlds" : " states of the worlds", " in which a team learns (opponents)"));
}

void horizon_fits(ConfigCheck& check) {
  if (!check.scenario || !check.scenario_knows("max_episode_length") || !check.known({"mappo.horizon"})) return;
  const int limit = check.scenario->max_episode_length.value_or(0), horizon = check.config.mappo.horizon;
  if (limit > 0 && horizon > limit)
    check.fail("mappo.horizon", cat(horizon, " is longer than an episode of scenario '", check.config.scenario,
                                    "' (max_episode_length ", limit, ")"));
}

/// Why the scenario does not pay a term; empty = it does; nothing where that is not known.
std::optional<std::string> not_paid_because(const ConfigCheck& check, RewardTerm term) {
  const std::string key = cat("rewards.", kRewardTermNames[static_cast<size_t>(term)]);
  const auto unless = [](bool paid, const std::string& why) { return std::optional(paid ? "" : why); };
  if (term == RewardTerm::idle_reward) {
    if (!check.spec || !check.scenario_knows("team_0") || !check.scenario_knows("team_1")) return std::nullopt;
    return unless(check.spec->params.has_idle_reward, "no agent type of its teams has idle_reward");
  }
  if (term == RewardTerm::hit_waypoint && check.spec && !check.spec->params.waypoints) return "it has no waypoints";
  if (!check.scenario || !check.scenario_knows(key)) return std::nullopt;
  const float weight = check.scenario->rewards[term];
  return unless(weight > 0, cat(key, " is ", weight));
}

std::string factor_key(RewardTerm term) {
  return cat("mappo.shaping_final_factors.", kRewardTermNames[static_cast<size_t>(term)]);
}

/// A reward with a factor of its own is paid, and fades or stays while others fade.
void single_rewards_fade(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    const std::optional<float> factor = c.shaping_final_factors[term];
    const std::string key = factor_key(term);
    if (!factor || !check.known({key})) continue;
    const std::string why = not_paid_because(check, term).value_or("");
    if (!why.empty())
      check.fail(key, cat(*factor, ": scenario '", check.config.scenario, "' does not pay this reward (", why,
                          "); allowed there: none"));
    else if (*factor == 1 && c.shaping_final_factor == 1 && check.known({"mappo.shaping_final_factor"}))
      check.fail(key,
                 "1: rewards do not fade where mappo.shaping_final_factor is 1; allowed there: less than 1, or none");
    else if (c.shaping_fade_start == 1 && check.known({"mappo.shaping_fade_start"}))
      check.fail(key, cat(*factor,
                          ": nothing fades before the end of the run, mappo.shaping_fade_start 1; allowed "
                          "there: none"));
  }
}

/// Where all rewards that a scenario pays fade alike, nothing but their scale changes.
void rewards_fade(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  single_rewards_fade(check);
  if (c.shaping_final_factor != 1 && c.shaping_fade_start == 1 && !check.has_begun &&
      check.known({"mappo.shaping_final_factor", "mappo.shaping_fade_start"}))
    check.fail("mappo.shaping_final_factor",
               cat(c.shaping_final_factor,
                   ": nothing fades before the end of the run, mappo.shaping_fade_start 1; allowed there: 1"));
  if (not_paid_because(check, RewardTerm::game_won).value_or("").empty()) return;
  if (!check.known({"mappo.shaping_final_factor"})) return;
  std::optional<float> of_all;
  std::optional<RewardTerm> own;
  for (int t = 0; t < kNRewardTerms; ++t) {
    const RewardTerm term = static_cast<RewardTerm>(t);
    const std::optional<std::string> why = not_paid_because(check, term);
    if (!why || !check.known({factor_key(term)})) return;
    if (!why->empty()) continue;
    if (c.shaping_final_factors[term]) own = term;
    const float factor = c.shaping_final_factors[term].value_or(c.shaping_final_factor);
    if (of_all && *of_all != factor) return;
    of_all = factor;
  }
  if (!of_all || *of_all == 1) return;
  if (own)
    check.fail(factor_key(*own), cat(*of_all, ": all rewards of scenario '", check.config.scenario,
                                     "' fade alike, and rewards.game_won, which does not fade, is off; allowed there: "
                                     "another one than those of the other rewards, or none"));
  else
    check.fail("mappo.shaping_final_factor",
               "all rewards but rewards.game_won fade, and that one is off in this scenario");
}

/// More than actions at random have no policy reaches, and the weight of the bonus would grow for ever.
void entropy_is_reached(ConfigCheck& check) {
  const std::optional<float> target = check.config.mappo.entropy_target;
  if (!target || check.has_begun || !check.spec || !check.scenario_knows("action") ||
      !check.known({"mappo.entropy_target"}))
    return;
  const bool discrete = check.spec->params.actions == ActionKind::discrete;
  const double most = discrete ? std::log(static_cast<double>(kNDiscreteActions)) : kActionSize * std::log(2.0);
  if (static_cast<double>(*target) >= most)
    check.fail("mappo.entropy_target",
               cat(*target, ": ", discrete ? "discrete" : "continuous", " actions at random have ",
                   static_cast<float>(most), " nats; allowed there: less"));
}

/// Options that need others.
void options_fit(ConfigCheck& check) {
  const MappoConfig& c = check.config.mappo;
  if (c.entropy_target && c.entropy_coef == 0 && check.known({"mappo.entropy_target", "mappo.entropy_coef"}))
    check.fail("mappo.entropy_target", "it begins at mappo.entropy_coef, which is 0");
  if (c.entropy_target && c.final_entropy_coef && check.known({"mappo.entropy_target", "mappo.final_entropy_coef"}))
    check.fail("mappo.final_entropy_coef",
               "the weight of the bonus follows mappo.entropy_target; allowed: one of both");
  if (c.shaping_fade_start > c.shaping_fade_end && check.known({"mappo.shaping_fade_start", "mappo.shaping_fade_end"}))
    check.fail("mappo.shaping_fade_start",
               cat(c.shaping_fade_start, " is after mappo.shaping_fade_end ", c.shaping_fade_end));
  entropy_is_reached(check);
  rewards_fade(check);
  const bool alone = !check.config.train.opponent.is_self_play();
  if (c.freeze_lead && alone && check.known({"mappo.freeze_lead", "train.opponent"}))
    check.fail("mappo.freeze_lead", "this means nothing where only one team learns (train.opponent)");
  if (c.step_back && (alone || check.config.opponents.scripted_share == 0) &&
      check.known({"mappo.step_back", "train.opponent", "opponents.scripted_share"}))
    check.fail("mappo.step_back", "it goes by games against opponents.scripted: set opponents.scripted_share");
}

/// The true state has numbers of every agent: of many no network reads it.
void state_is_read(ConfigCheck& check) {
  if (check.spec && check.spec->params.n_agents > kMaxAgents && check.config.mappo.critic.kind == CriticKind::state &&
      check.known({"mappo.critic.kind"}))
    check.fail("mappo.critic.kind",
               cat("state: scenario '", check.config.scenario, "' has ", check.spec->params.n_agents,
                   " agents in a world, and the true state tells of at most ", kMaxAgents,
                   "; allowed: composed, independent"));
}

void check_mappo(ConfigCheck& check) {
  state_is_read(check);
  networks_see(check);
  view_is_taught(check);
  mirror_shows_all(check);
  no_team_rests(check);
  memory_has_steps(check);
  worlds_suffice(check);
  minibatches_divide(check);
  shards_divide(check);
  horizon_fits(check);
  options_fit(check);
}

void expect_shards_divide(const RunConfig& c, int n_ranks) {
  const int shards = c.mappo.shards, below = shards / n_ranks * n_ranks;
  if (below != shards)
    throw InputError(cat("mappo.shards: ", shards, " cannot be divided among ", n_ranks,
                         " ranks; nearest: ", below > 0 ? cat(below, ", ") : "", below + n_ranks));
}

// n_worlds x horizon must be a multiple of n_minibatches, with memory n_worlds itself; in each shard.
RunSize mappo_size(const RunConfig& c) {
  const int64_t divides = c.mappo.horizon / steps_together(c.mappo);
  int64_t step = c.mappo.shards * (c.mappo.n_minibatches / std::gcd<int64_t>(c.mappo.n_minibatches, divides));
  // With further opponents a team learns in half of the worlds at least, and each minibatch needs a state of every
  // shard, with memory a whole world.
  if ((c.mappo.shards > 1 || steps_together(c.mappo) > 1) && has_further_opponents(c.opponents)) step *= 2;
  return {"train.n_worlds", "world", c.train.n_worlds, step, step, kMostWorlds};
}

/// What a rollout keeps of observations, and what images would take that it does not keep.
struct RolloutBytes {
  int64_t numbers = 0, image_states = 0, images = 0;
};
RolloutBytes rollout_bytes(const LoadedRun& run) {
  const SimParams& p = run.spec.params;
  const TrainConfig& c = run.config.train;
  const MappoConfig& m = run.config.mappo;
  const int64_t agents = c.opponent.is_self_play() ? p.n_agents : p.n_team[c.learning_team];
  const int64_t states = static_cast<int64_t>(c.n_worlds) * m.horizon;
  const NetworkConfig& for_critic = encodes_for_critic(m);
  const bool critic_sees = m.critic.kind != CriticKind::state;
  const auto reads_numbers = [](const NetworkConfig& network) { return !network.reads_image(); };
  RolloutBytes bytes;
  if (reads_numbers(m.actor) || (critic_sees && reads_numbers(for_critic)) || m.view_coef > 0)
    bytes.numbers = states * agents * static_cast<int64_t>(sizeof(float)) * observation_rows(run.spec).stride();
  if (m.actor.reads_image() || (critic_sees && for_critic.reads_image())) {
    bytes.image_states = states * static_cast<int64_t>(sizeof(int32_t)) * image_state_size(p);
    bytes.images = states * agents * image_bytes(p.resolution);
  }
  return bytes;
}

/// The state of the worlds, and the observations of the rollout.
int64_t mappo_least_bytes(const LoadedRun& run) {
  const RolloutBytes kept = rollout_bytes(run);
  return static_cast<int64_t>(state_bytes({run.spec, {.pairs = run.config.train.pairs}}, run.config.train.n_worlds)) +
         kept.numbers + kept.image_states;
}

RedrawnImages mappo_redrawn(const LoadedRun& run) {
  const RolloutBytes bytes = rollout_bytes(run);
  return {bytes.images, bytes.image_states};
}

}  // namespace

bool ShapingFactors::any() const {
  return std::any_of(of_term.begin(), of_term.end(), [](const auto& factor) { return factor.has_value(); });
}

int64_t agent_steps_per_update(const RunConfig& c, int n_agents) {
  return static_cast<int64_t>(c.train.n_worlds) * c.mappo.horizon * n_agents;
}

bool has_one_policy(const RunConfig& c, const SimSpec& spec) {
  return c.mappo.one_policy && c.train.opponent.is_self_play() && teams_are_alike(spec);
}

ResumeRules MappoSettings::resume_rules() { return {kMappoMayChange, kMappoMayNot}; }

const Algorithm MappoAlgorithm::kAlgorithm = {
    .name = "mappo",
    .about = "PPO in self-play, with a centralized critic per team",
    .figures =
        "policy_loss, value_loss, entropy and mutual_information (nats), approx_kl, clip_fraction,\n"
        "explained_variance, actor_grad_norm, critic_grad_norm",
    .updates = "updates",
    .has_populations = false,
    .unread = kMappoUnread,
    .charts = kMappoCharts,
    .policy =
        [](const RunConfig& c) {
          return PolicySettings{c.mappo.actor, false, c.mappo.obs_norm, c.mappo.fused};
        },
    .agent_steps_per_update = agent_steps_per_update,
    .check = check_mappo,
    .expect_divides = expect_shards_divide,
    .setting_for_ranks =
        [](const RunConfig& c, int n_ranks) {
          return c.mappo.shards == MappoConfig{}.shards ? cat("mappo.shards=", n_ranks) : "";
        },
    .size = mappo_size,
    .set_size = [](RunConfig& c, int64_t size) { c.train.n_worlds = static_cast<int>(size); },
    .shorten = [](RunConfig& c) { c.mappo.n_epochs = 1; },
    .least_bytes = mappo_least_bytes,
    .redrawn = mappo_redrawn,
};

}  // namespace giga
