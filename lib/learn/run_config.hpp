// RunConfig: everything that a training run can be told in YAML, with the defaults.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "config/duration.hpp"
#include "config/fields.hpp"
#include "learn/registry.hpp"
#include "policy/config.hpp"
#include "scenario/scenario.hpp"
#include "scripted/script.hpp"
#include "sim/simulator.hpp"

namespace giga {

/// Who plays the other side while a team learns: the name `self_play` (both learn), that of a script, or the path of a
/// run, a checkpoint or an exported policy. What has a slash or a dot is a path.
struct Opponent {
  std::string name = "self_play";

  bool is_self_play() const { return name == "self_play"; }
  bool is_path() const { return name.find_first_of("/.") != std::string::npos; }
  /// Of the name of a script.
  Scripted script() const;
};
template <>
struct FieldCodec<Opponent> {
  static bool read(const Node& node, Opponent& value, const Allowed& allowed, const ReadSite& site);
  static std::string print(const Opponent& value) { return print_text(value.name); }
  static std::string expected(const Allowed& allowed);
  static ValueShape shape(const Allowed& allowed);
};

constexpr std::array<const char*, 3> enum_names(Pairs) { return {"auto", "tables", "by_place"}; }
constexpr std::array<const char*, 3> enum_names(CompileStep) { return {"never", "auto", "always"}; }

/// The most worlds that a run may step in parallel.
constexpr int kMostWorlds = 16'777'216;

struct TrainConfig {
  std::string algorithm = "mappo";
  int64_t total_agent_steps = 250'000'000;
  int n_worlds = 4096;
  Opponent opponent;
  int learning_team = 0;
  int n_threads = 0;
  Precision precision = Precision::tf32;
  bool desynchronize = true;
  Pairs pairs = Pairs::automatic;
  CompileStep compile_step = CompileStep::automatic;
  std::optional<Duration> max_wall_time = std::nullopt;
  std::optional<int64_t> stop_at_agent_steps = std::nullopt;
};
template <class V>
void visit_fields(V& v, TrainConfig& c) {
  v("algorithm", c.algorithm, "learning algorithm", one_of(algorithm_names()));
  v("total_agent_steps", c.total_agent_steps,
    "agent-steps after which the run is complete, its update being finished; mappo: worlds x agents x steps; "
    "evolution: those of all episodes",
    at_least(1));
  v("n_worlds", c.n_worlds, "mappo: worlds stepped in parallel", range(1, kMostWorlds));
  v("opponent", c.opponent,
    "self_play: both teams learn. Else the team that does not learn plays this script, or the frozen policy of a run "
    "(its best checkpoint), a checkpoint or an exported policy or, with mappo, a mixed team of such (a .yaml file that "
    "lists them under policies), which share the worlds: a path, such as ./runs/first");
  v("learning_team", c.learning_team, "the team that learns where train.opponent is not self_play", range(0, 1));
  v("n_threads", c.n_threads, "CPU back end: threads; 0 = one per core", range(0, 4096));
  v("precision", c.precision,
    "arithmetic of networks on the GPU while training; parameters stay fp32. The CPU always computes in "
    "fp32. Export computes in fp32 what was trained in tf32, and so do eval and rate where LibTorch plays it "
    "(docs/architecture.md says when). tf32: factors of matrix products are rounded to 10 bits of mantissa. bf16: "
    "weights and features are bfloat16. fp16 is for "
    "openai_es, snes and des: weights, biases and the inputs of each layer are rounded to half precision; "
    "sums are fp32. One fused kernel computes all members, with a tanh that is off by up to 2^-11 of its "
    "value. It takes up to 3 hidden layers of up to 128, without layer_norm. Perturbations far below "
    "2^-11 of a weight are lost to rounding");
  v("desynchronize", c.desynchronize,
    "mappo: the first episodes end at different times, so that the worlds do not reset together");
  v("pairs", c.pairs,
    "how worlds know which pairs of agents matter: by tables of all pairs, or by place, in a grid of cells, where of "
    "those who fire at an agent at once at most 64 are counted and more are an error. auto: by place from 128 agents "
    "in a world on, and from 100 on where no team has more than 64, except where agents are given images, which need "
    "tables. Above 1,024 always by place. The numbers are the same, bit for bit");
  v("compile_step", c.compile_step,
    "on a GPU, compile the step of worlds of up to 40 agents for this scenario at the start, with its parameters as "
    "constants: it is "
    "faster then. That takes some seconds once; the result is kept in $GIGASTEP_CACHE_DIR, else in "
    "$XDG_CACHE_HOME/gigastep, else in ~/.cache/gigastep. auto: where the program has no kernel for scenarios of this "
    "kind. The numbers are the same, bit for bit");
  v("max_wall_time", c.max_wall_time, "save and stop after this time of one `train` or `resume`");
  v("stop_at_agent_steps", c.stop_at_agent_steps,
    "evaluate, save and stop once so many agent-steps are done; schedules go by total_agent_steps still", at_least(1));
}

/// How an opponent is drawn from the pool: all alike, later ones more often, or those more often that are hard to beat.
enum class PoolDraw : uint8_t { uniform, recency, pfsp };
constexpr std::array<const char*, 3> enum_names(PoolDraw) { return {"uniform", "recency", "pfsp"}; }

/// Whether a policy joins the pool at each turn, or only one that is stronger than those in it.
enum class PoolPromotion : uint8_t { always, evidence };
constexpr std::array<const char*, 2> enum_names(PoolPromotion) { return {"always", "evidence"}; }

/// Whom the teams meet, besides the other team as it is.
struct OpponentsConfig {
  int pool_size = 0;
  int pool_every_updates = 100;
  float pool_share = 0.25f;
  PoolDraw pool_draw = PoolDraw::uniform;
  float pool_hardness = 2.0f;
  PoolPromotion pool_promotion = PoolPromotion::always;
  std::vector<std::string> policies = {};
  std::vector<Scripted> scripted = {Scripted::circle};
  float scripted_share = 0.0f;
};
template <class V>
void visit_fields(V& v, OpponentsConfig& c) {
  v("pool_size", c.pool_size,
    "past policies of each team (evolution: past means) that the other team may meet; 0 = none", range(0, 10'000));
  v("pool_every_updates", c.pool_every_updates,
    "updates after which the present policy joins the pool; mappo then also draws new opponents, which are met from "
    "the next games on: one that is on is finished against the opponent that it began with. Where a world is still "
    "in a game against the opponent before, those that share its opponent keep theirs for this turn",
    at_least(1));
  v("pool_share", c.pool_share,
    "share of the worlds (mappo; each team learns in half of them) or of a member's episodes (evolution) "
    "against the pool; while the pool is empty, against the other team as it is",
    range(0, 1));
  v("pool_draw", c.pool_draw,
    "uniform: all alike; recency: the newest of K policies K times as often as the oldest, linear in "
    "between, and those of `policies` as often as the newest; pfsp: in proportion to (1 - win rate) ^ pool_hardness "
    "(prioritised fictitious self-play, "
    "Vinyals et al. 2019, doi 10.1038/s41586-019-1724-z). There a tie is half a win, and results count "
    "half as much after each pool_every_updates");
  v("pool_hardness", c.pool_hardness, "pool_draw pfsp: the larger, the more often strong opponents are drawn",
    range(0, 100));
  v("pool_promotion", c.pool_promotion,
    "always: the present policy joins the pool at each turn; evidence (mappo): only where since the last one joined it "
    "has won more games against the other team's pool than it lost, by 1.65 x the root of both together (95 % sure "
    "that it is better, had one looked once; it is looked at each turn), or the other team's pool holds no past policy "
    "yet");
  v("policies", c.policies,
    "mappo: runs (their best checkpoint, or else the newest) or checkpoints, as paths, whose teams stay in the pool "
    "besides "
    "pool_size past policies, such as the best responses of `gigastep exploit` to an earlier run; their networks must "
    "be "
    "like those of this run. Checkpoints hold them, so a run goes on without the files",
    Allowed{}.items(0, 64));
  v("scripted", c.scripted, "scripted opponents, in turn (evolution: from generation to generation too)",
    Allowed{}.items(1, 64));
  v("scripted_share", c.scripted_share,
    "share of the worlds (mappo; each team learns in half of them) or of a member's episodes (evolution) "
    "against scripts",
    range(0, 1));
}

struct EvalConfig {
  int every_updates = 50;
  int episodes = 512;
  std::vector<Scripted> opponents = {Scripted::random, Scripted::circle};
  int record = 2;
};
template <class V>
void visit_fields(V& v, EvalConfig& c) {
  v("every_updates", c.every_updates, "updates between evaluations; 0 = only at the end", at_least(0));
  v("episodes", c.episodes, "episodes per side and opponent, new ones at each evaluation", range(1, 1'000'000));
  v("opponents", c.opponents, "scripted opponents to play against");
  v("record", c.record,
    "games of the two teams of the run that each evaluation keeps as a replay, in replays/; the page replays.html "
    "shows them; 0 = none",
    range(0, 1000));
}

struct CheckpointConfig {
  int every_updates = 100;
  int keep = 3;
  bool keep_best = true;
};
template <class V>
void visit_fields(V& v, CheckpointConfig& c) {
  v("every_updates", c.every_updates, "updates between checkpoints; 0 = only at the end", at_least(0));
  v("keep", c.keep, "newest checkpoints that are kept", at_least(1));
  v("keep_best", c.keep_best,
    "also keep the best one, as best.h5: the one in which the weaker team's mean win rate over "
    "eval.opponents is highest; the scenario says what a win is (win)");
}

/// The groups of the algorithms (`mappo`, `population`, ...) are its bases.
struct RunConfig : Algorithms::Settings {
  std::string scenario = "identical_5_vs_5";
  Node environment;
  std::optional<Rules> rules = std::nullopt;
  uint64_t seed = 1;
  std::string device = "auto";
  TrainConfig train;
  OpponentsConfig opponents;
  EvalConfig eval;
  CheckpointConfig checkpoint;
};
template <class V>
void visit_fields(V& v, RunConfig& c) {
  v("scenario", c.scenario, "name of a scenario, with suffixes if wanted, or path of a scenario file");
  v.tree("environment", c.environment, "changes to the scenario: any of its keys", fields_of_default<Scenario>);
  v("rules", c.rules, "corrected or original; none = as the scenario says");
  v("seed", c.seed, "seed of everything random in the run");
  v("device", c.device, "auto, cpu, cuda or cuda:<number>");
  v.group("train", c.train, "the run");
  visit_groups(v, c);
  v.group("opponents", c.opponents, "whom the teams meet besides each other (train.opponent self_play)");
  v.group("eval", c.eval, "evaluation while training");
  v.group("checkpoint", c.checkpoint, "checkpoints");
}

/// What the algorithm of a run says; see Algorithm.
inline bool acts_greedily(const RunConfig& c) { return algorithm_of(c).policy(c).greedy; }
/// Updates until train.total_agent_steps are reached; none where an update's agent-steps are known only afterwards.
std::optional<int64_t> total_updates(const RunConfig& c, int n_agents);

/// Reads a run's YAML with overrides; throws InputError with all mistakes, including those that show only in the
/// combination of keys (a horizon longer than the episode, minibatches that do not divide).
struct LoadedRun {
  RunConfig config;
  Scenario scenario;                    ///< resolved, with `rules` applied
  SimSpec spec;                         ///< compiled
  std::optional<Position> opponent_at;  ///< where train.opponent was given, for messages
  std::optional<Position> policies_at;  ///< and opponents.policies
  std::optional<Position> scenario_at;  ///< and scenario
  /// The run goes on from a checkpoint, which holds the policies of opponents.policies.
  bool policies_are_saved = false;
  /// Its worlds met other opponents than they meet now (mappo.shards, shares of opponents).
  bool opponents_move = false;
  /// It met other scripts (opponents.scripted).
  bool other_scripts = false;
};
/// `change` is made to what was read before it is checked: mistakes are told where the user wrote them.
LoadedRun load_run_config(const std::string& path, const std::vector<std::string>& overrides,
                          const std::function<void(RunConfig&)>& change = {});
/// Makes paths of opponents.policies whole, so that the run's own config names them from anywhere; notes those that are
/// not there; `at`: where they were named.
void find_policies(RunConfig& config, const Position& at, Errors& errors);
/// The same of a path in train.opponent; `given`: where the keys were.
void find_opponent(RunConfig& config, const KeyPositions& given, Errors& errors);
/// A run's config as its folder keeps it, from which it trains the same again wherever the folder is: where the
/// scenario is a file, or files are named in `environment`, it names a file beside it that is to hold the whole
/// scenario.
RunConfig for_run_folder(RunConfig config);
/// The same from the text of a resolved config (of a checkpoint), with the scenario's own text.
LoadedRun load_run_config_text(const std::string& config_yaml, const std::string& scenario_yaml);

}  // namespace giga
