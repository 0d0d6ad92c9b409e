// Bad inputs, one of each kind: exit code 2, a message that tells where and what is allowed, and nothing created. The
// same table makes docs/bad_input.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>

#include "core/error.hpp"
#include "core/shell_word.hpp"
#include "io/files.hpp"
#include "program.hpp"
#include "support/source.hpp"
#include "support/thinning.hpp"

namespace giga::test {
namespace {

struct BadInput {
  std::string kind;
  std::string shown;  ///< the input in the table, lines in code
  std::vector<std::string> arguments;
  std::map<std::string, std::string> files;
  std::vector<std::string> parts;       ///< of the message
  std::vector<std::string> first = {};  ///< arguments of a command before, which makes the folder `other`
};

// Were an input taken for a good one, training would end after one update.
const std::vector<std::string> kTrain = {"train", "run.yaml", "--set", "train.total_agent_steps=1"};
const std::vector<std::string> kTrainAsItIs = {"train", "run.yaml"};
constexpr const char* kGame = "scenario: identical_2_vs_2\n";

/// The shortest run in that game, for a folder `other`.
constexpr const char* kShortest =
    "device: cpu\n"
    "train: {n_threads: 1, n_worlds: 2, total_agent_steps: 1}\n"
    "eval: {episodes: 1, every_updates: 0, record: 0}\n";
const std::vector<std::string> kTrainOther = {"train", "other.yaml", "--run-dir", "other", "--quiet"};

/// A line or more of a run config.
BadInput in_config(const std::string& kind, const std::string& lines, const std::vector<std::string>& parts) {
  return {kind, lines, kTrain, {{"run.yaml", kGame + lines + "\n"}}, parts};
}
/// Of an evolution strategy.
BadInput in_evolution(const std::string& kind, const std::string& lines, const std::vector<std::string>& parts) {
  BadInput input = in_config(kind, lines, parts);
  input.arguments = kTrainAsItIs;
  return input;
}
/// The same without anything before it.
BadInput whole_config(const std::string& kind, const std::string& text, const std::string& shown,
                      const std::vector<std::string>& parts) {
  return {kind, shown, kTrain, {{"run.yaml", text}}, parts};
}
/// A scenario file.
BadInput in_scenario(const std::string& kind, const std::string& lines, const std::vector<std::string>& parts) {
  return {kind,
          lines,
          kTrain,
          {{"run.yaml", "scenario: ./game.yaml\n"}, {"game.yaml", "base: identical_2_vs_2\n" + lines + "\n"}},
          parts};
}
BadInput on_command_line(const std::string& kind, const std::string& shown, const std::vector<std::string>& arguments,
                         const std::vector<std::string>& parts) {
  return {kind, shown, arguments, {{"run.yaml", kGame}}, parts};
}

std::vector<std::string> train_with_set(const std::string& assignment) {
  std::vector<std::string> arguments = kTrain;
  arguments.insert(arguments.end(), {"--set", assignment});
  return arguments;
}

std::vector<BadInput> form_of_files() {
  return {
      in_config("unknown key", "mappo: {gama: 0.9}", {"run.yaml:2:9: mappo.gama: unknown key; nearest: 'gamma'"}),
      in_config(
          "duplicate key, and more", "seed: 1\nseed: 2\ndevice: gpu",
          {"run.yaml:3:1: duplicate key 'seed', first given at line 2", "run.yaml:4:9: device: 'gpu' is not auto"}),
      in_config("anchor and alias", "seed: &s 1\ntrain: {n_worlds: *s}",
                {"run.yaml:2:7: anchors are not allowed: &s", "run.yaml:3:19: aliases are not allowed: *s"}),
      in_config("tag", "seed: !!int 1", {"run.yaml:2:7: tags are not allowed: tag:yaml.org,2002:int"}),
      whole_config("empty document", "# nothing\n", "# nothing", {"run.yaml:1:1: is empty", "scenario, environment"}),
      in_config("several documents", "---\nseed: 2", {"run.yaml:3:1: a second document starts here"}),
      whole_config("not UTF-8", "seed: \xE4\n", "seed: (byte 228)", {"run.yaml:1:7: not UTF-8: byte 228"}),
      in_config("not YAML", "train: {n_worlds: 64", {"run.yaml:", ": not valid YAML: "}),
      in_config("tab", "train:\n\tn_worlds: 64", {"run.yaml:3:1: a tab before the key; YAML is indented with spaces"}),
      in_config("indentation", "train:\n  n_worlds: 64\n   n_threads: 1",
                {"run.yaml:4:4: indented by 3 spaces, the key above it by 2"}),
      in_config("colon left out", "train:\n  n_worlds 64\n  n_threads: 1",
                {"run.yaml:3:3: a key without its colon, as in `gamma: 0.9`: '  n_worlds 64'"}),
      in_config("key in the wrong group", "n_worlds: 64\nrewards: {damage: 5}",
                {"run.yaml:2:1: n_worlds: unknown key; did you mean 'train.n_worlds'?",
                 "run.yaml:3:1: rewards: unknown key; did you mean 'environment.rewards.damage'?"}),
      in_config("short name of a key", "mappo: {lr: 0.1}", {"mappo.lr: unknown key; nearest: 'learning_rate'"}),
      in_config("nested too deeply", "environment: " + std::string(600, '['), {"run.yaml:3:1: nested too deeply"}),
      on_command_line("missing config", "gigastep train quikstart", {"train", "quikstart"},
                      {"there is no config quikstart; nearest: 'quickstart'"}),
      in_config("base that is not there", "base: mappo_leage",
                {"run.yaml:2:7: base: there is no config 'mappo_leage'; nearest: 'mappo_league'"}),
      {"missing scenario file",
       "scenario: gmae.yaml",
       kTrain,
       {{"run.yaml", "scenario: gmae.yaml\n"}, {"game.yaml", "base: identical_2_vs_2\n"}},
       {"run.yaml:1:11: no such file: gmae.yaml; nearest: 'game.yaml'"}},
      {"scenario in the place of a config",
       "gigastep train game.yaml",
       {"train", "game.yaml"},
       {{"game.yaml", "base: identical_2_vs_2\nlimit_x: 12\n"}},
       {"game.yaml: this is a scenario, not a config; to train in it: gigastep train quickstart --set "
        "scenario=game.yaml"}},
      {"sweep in the place of a config",
       "gigastep train rates.yaml",
       {"train", "rates.yaml"},
       {{"rates.yaml", "config: quickstart\nparameters: {mappo.gamma: {choices: [0.9, 0.99]}}\nmetric: return_0\n"}},
       {"rates.yaml: this is a sweep, not a config; to run it: gigastep sweep rates.yaml"}},
      {"config in the place of a sweep",
       "gigastep sweep run.yaml",
       {"sweep", "run.yaml"},
       {{"run.yaml", kGame}},
       {"run.yaml: this is a config, not a sweep; to train by it: gigastep train run.yaml"}},
      {"config in the place of a policy",
       "gigastep eval run.yaml --vs circle",
       {"eval", "run.yaml", "--vs", "circle"},
       {{"run.yaml", kGame}},
       {"run.yaml: this is a config, not a policy; to train by it: gigastep train run.yaml"}},
      {"mixed team in the place of a config",
       "gigastep train team.yaml",
       {"train", "team.yaml"},
       {{"team.yaml", "policies: [circle, pursuer]\n"}},
       {"team.yaml: this is a mixed team, not a config"}},
      {"folder in the place of a config",
       "gigastep train ./here",
       {"train", "./here"},
       {{"here/notes.txt", "\n"}},
       {"./here: is a folder, not a config"}},
      {"file in the place of a run",
       "gigastep report run.yaml",
       {"report", "run.yaml"},
       {{"run.yaml", kGame}},
       {"run.yaml is a file, not the folder of a run"}},
      {"config in the place of a checkpoint",
       "gigastep resume run.yaml",
       {"resume", "run.yaml"},
       {{"run.yaml", kGame}},
       {"run.yaml is neither the folder of a run nor a checkpoint"}},
  };
}

std::vector<BadInput> values() {
  return {
      in_config("wrong type", "train: {n_worlds: many}",
                {"run.yaml:2:19: train.n_worlds: 'many' is not an integer in"}),
      in_config("wrong type, a map", "mappo: 3", {"run.yaml:2:8: mappo: is '3', expected a map with keys out of:"}),
      in_config("out of range", "mappo: {gamma: 1.5}", {"run.yaml:2:16: mappo.gamma: '1.5' is not a number in [0, 1]"}),
      in_config("too large for its type", "checkpoint: {keep: 3e9}",
                {"run.yaml:2:20: checkpoint.keep: '3e9' is not an integer in [1, 2147483647]"}),
      in_config("non-finite number", "mappo: {entropy_coef: .nan, value_coef: 1e999}",
                {"run.yaml:2:23: mappo.entropy_coef: '.nan' is not a finite number >= 0",
                 "run.yaml:2:41: mappo.value_coef: '1e999' is not a number of 32 bits >= 0"}),
      in_config("wrong number of items", "mappo: {actor: {hidden: []}}",
                {"run.yaml:2:25: mappo.actor.hidden: has 0 items, expected a list of 1 to 16 items"}),
      in_config("list without brackets", "mappo:\n  actor:\n    hidden: 64, 64",
                {"run.yaml:4:13: mappo.actor.hidden: '64, 64' is not a list of 1 to 16 items", "; write [64, 64]"}),
      in_config("unknown name", "mappo: {schedule: cosin}",
                {"run.yaml:2:19: mappo.schedule: 'cosin' is not one of: constant, linear, cosine; nearest: 'cosine'"}),
      in_config("unknown device", "device: tpu", {"run.yaml:2:9: device: 'tpu' is not auto, cpu, cuda or cuda:"}),
      in_config("unknown scripted opponent", "train: {opponent: circel}\neval: {opponents: [randm]}",
                {"run.yaml:2:19: train.opponent: 'circel' is not one of:", "nearest: 'circle'",
                 "run.yaml:3:20: eval.opponents[0]: 'randm' is not one of:", "nearest: 'random'"}),
      on_command_line(
          "unknown scripted opponent of eval", "gigastep eval runs/x --vs circel", {"eval", "runs/x", "--vs", "circel"},
          {"'circel' is neither a scripted team nor a file or folder; nearest: 'circle'; scripted teams: random"}),
      on_command_line(
          "unknown scripted opponent of rate", "gigastep rate runs/x --scripted random,circel",
          {"rate", "runs/x", "--scripted", "random,circel"},
          {"--scripted random,circel: 'circel' is no scripted team; nearest: 'circle'; allowed: all, none"}),
      on_command_line("unknown format of export", "gigastep export runs/x --team 0 --format onyx --out new",
                      {"export", "runs/x", "--team", "0", "--format", "onyx", "--out", "new"},
                      {"format 'onyx' is unknown; nearest: 'onnx'; allowed: safetensors, onnx, torchscript"}),
      on_command_line("option that is no number", "--seed abc", {"train", "run.yaml", "--seed", "abc"},
                      {"--seed: 'abc' is not an integer >= 0"}),
      on_command_line("option out of range", "gigastep eval runs/x --vs circle --episodes 0",
                      {"eval", "runs/x", "--vs", "circle", "--episodes", "0"},
                      {"--episodes: '0' is not an integer in [1, 10000000]"}),
      on_command_line("option without its value", "gigastep eval runs/x --vs", {"eval", "runs/x", "--vs"},
                      {"--vs: a value is missing"}),
      BadInput{"folder of a run in the place of a config",
               "gigastep train mine",
               {"train", "mine"},
               {{"mine/config.yaml", kGame}},
               {"mine: this is the folder of a run, not a config; to go on with it: gigastep resume mine"}},
      on_command_line("assignment without a value", "--set seed", train_with_set("seed"),
                      {"--set seed: expected KEY=VALUE"}),
      on_command_line("assignment to an unknown key", "--set mappo.gama=0.9", train_with_set("mappo.gama=0.9"),
                      {"--set mappo.gama: unknown key; nearest: 'gamma'"}),
      on_command_line("assignment with a blank", "--set mappo.gamma 0.9",
                      {"train", "run.yaml", "--set", "mappo.gamma", "0.9"}, {"write --set mappo.gamma=0.9"}),
      on_command_line("key as an option", "--mappo.gamma=0.9", {"train", "run.yaml", "--mappo.gamma=0.9"},
                      {"write --set mappo.gamma=0.9"}),
      on_command_line("list without quotes", "--set mappo.actor.hidden=[64, 64]",
                      {"train", "run.yaml", "--set", "mappo.actor.hidden=[64,", "64]"},
                      {"write --set 'mappo.actor.hidden=[64, 64]'"}),
      on_command_line("assignment of a wrong value", "--set mappo.gamma=2", train_with_set("mappo.gamma=2"),
                      {"--set mappo.gamma: '2' is not a number in [0, 1]"}),
      on_command_line("agent type that the game does not have", "--set environment.agent_types.defalt.thrust=3",
                      train_with_set("environment.agent_types.defalt.thrust=3"),
                      {"environment.agent_types.defalt: the game has no 'defalt'; nearest: 'default'"}),
  };
}

std::vector<BadInput> meanings() {
  return {
      whole_config("unknown scenario", "scenario: identcal_2_vs_2\n", "scenario: identcal_2_vs_2",
                   {"run.yaml:1:11: unknown scenario 'identcal_2_vs_2'; nearest: 'identical_2_vs_2'"}),
      in_config("empty team", "environment: {team_1: []}", {"run.yaml:2:23: team_1: the team is empty"}),
      in_config("unknown agent type", "environment: {team_0: [{type: supper}]}",
                {"run.yaml:2:31: team_0[0].type: unknown agent type 'supper'; nearest: 'super'; known: default"}),
      in_config("unknown map", "environment: {maps: two_room}",
                {"run.yaml:2:21: maps: unknown map 'two_room'; nearest: 'two_rooms1'; known: center_block"}),
      in_config("all maps among others", "environment: {maps: [empty, all]}",
                {"run.yaml:2:29: maps: 'all' stands alone, as maps: all; in a list name each map: center_block"}),
      in_scenario("start area outside the map", "maps: m\nmap_definitions: {m: {team_0: {area: [6, 1, 11, 9]}}}",
                  {"game.yaml:3:38: map 'm': the start area of team 0, [6, 1, 11, 9], reaches outside"}),
      in_scenario("start area inside an obstacle", "maps: m\nmap_definitions: {m: {boxes: [[0, 0, 5, 10]]}}",
                  {"game.yaml:3:19: map 'm': the start area of team 1, [1, 1, 4, 9], lies inside an obstacle"}),
      in_config("batch that does not divide", "train: {n_worlds: 10}\nmappo: {horizon: 5, n_minibatches: 4}",
                {"run.yaml:3:36: mappo.n_minibatches: 4 does not divide train.n_worlds x mappo.horizon = 10 x 5 = 50",
                 "nearest: 2, 5"}),
      in_config("a part of the observation that is not there", "mappo: {critic: {inputs: egocentric}}",
                {"run.yaml:2:26: mappo.critic.inputs: 'egocentric' needs environment.observation.egocentric_view: "
                 "true; allowed",
                 "without it: all"}),
      in_config("fade of a reward that is off", "mappo: {shaping_final_factors: {damage: 0}}",
                {"run.yaml:2:41: mappo.shaping_final_factors.damage: 0: scenario 'identical_2_vs_2' does not pay this "
                 "reward (rewards.damage is 0); allowed there: none"}),
      in_evolution("odd population of pairs", "train: {algorithm: openai_es}\npopulation: {population_size: 33}",
                   {"run.yaml:3:31: population.population_size: 33 is odd", "nearest: 32, 34"}),
      in_evolution("population out of range",
                   "train: {algorithm: snes}\npopulation: {population_size: 1, sigma_init: 0}",
                   {"run.yaml:3:31: population.population_size: '1' is not an integer in [2, 1000000]",
                    "run.yaml:3:46: population.sigma_init: '0' is not a number > 0"}),
      in_evolution(
          "rank beyond the weight matrices", "train: {algorithm: des}\npopulation: {noise: low_rank, noise_rank: 65}",
          {"run.yaml:3:43: population.noise_rank: 65 is more than the smaller side of any weight matrix; at most 64"}),
      in_evolution(
          "episodes that do not come out even",
          "train: {algorithm: snes}\npopulation: {episodes_per_member: 16, parallel_episodes: 5}",
          {"run.yaml:3:58: population.parallel_episodes: 5 does not divide population.episodes_per_member 16"}),
      in_evolution("shares of which a member has no episode",
                   "train: {algorithm: snes}\npopulation: {episodes_per_member: 2}\nopponents: {scripted_share: 0.2}",
                   {"run.yaml:4:29: opponents.scripted_share: 0.2 of the 2 episodes that a member plays at a time "
                    "(population.episodes_per_member) is none"}),
      in_evolution("scripts that leave no episode",
                   "train: {algorithm: des}\npopulation: {episodes_per_member: 4, parallel_episodes: 1}\n"
                   "opponents: {scripted_share: 0.5}",
                   {"run.yaml:4:29: opponents.scripted_share: scripts take 1 and the pool 0 of the 1 episode that a "
                    "member plays at a time (population.parallel_episodes), and the other team as it is now none"}),
      in_evolution("waypoints where there are none", "train: {algorithm: openai_es}\npopulation: {objective: score}",
                   {"run.yaml:3:25: population.objective: 'score' counts waypoints, and this scenario has none; "
                    "allowed here: auto, return, win_rate"}),
      in_evolution("key that there was once", "train: {algorithm: openai_es}\npopulation: {generations: 5}",
                   {"run.yaml:3:14: population.generations: there is no such key any more: a run ends after "
                    "train.total_agent_steps, whatever its algorithm"}),
      in_evolution(
          "shares of opponents beyond one",
          "train: {algorithm: openai_es}\nopponents: {pool_size: 2, pool_share: 0.7, scripted_share: 0.6}",
          {"run.yaml:3:39: opponents.pool_share: 0.7 and opponents.scripted_share 0.6 are more than 1 together"}),
      in_config("frozen opponents where one team is scripted",
                "train: {opponent: circle}\nopponents: {pool_size: 4, scripted_share: 0.1}",
                {"run.yaml:3:24: opponents.pool_size: this means nothing with train.opponent circle",
                 "run.yaml:3:43: opponents.scripted_share: this means nothing with train.opponent circle"}),
      in_config("a team that learns, in self-play", "train: {learning_team: 1}",
                {"run.yaml:2:24: train.learning_team: 1: this means nothing with train.opponent self_play"}),
      in_config("an opponent of evaluations twice", "eval: {opponents: [circle, random, circle]}",
                {"run.yaml:2:19: eval.opponents: circle is there twice; allowed: each once"}),
      in_config("script among the policies of the pool", "opponents: {pool_size: 4, policies: [pursuer]}",
                {"run.yaml:2:37: opponents.policies: pursuer is a script: opponents.scripted takes scripts"}),
      in_config("policy of the pool that is not there", "opponents: {policies: [./nobody]}",
                {"run.yaml:2:23: opponents.policies: there is no run or checkpoint ./nobody"}),
      in_config("share of opponents without a world",
                "train: {n_worlds: 16}\nopponents: {pool_size: 4, pool_share: 0.05}",
                {"run.yaml:3:39: opponents.pool_share: 0.05 of train.n_worlds 16 leaves each team 0 worlds against the "
                 "pool; it needs at least 1"}),
      in_evolution("setting of another algorithm", "train: {algorithm: openai_es, n_worlds: 64}",
                   {"run.yaml:2:41: train.n_worlds: this means nothing to train.algorithm openai_es"}),
      in_config(
          "encoder of images without images", "mappo: {actor: {encoder: nature}}",
          {"run.yaml:2:26: mappo.actor.encoder: 'nature' reads images, and agents of 'identical_2_vs_2' are given "
           "none; environment.observation.type: rgb or rgb_vector gives them; allowed without images: mlp"}),
      in_config("image too small for the encoder",
                "environment: {observation: {type: rgb_vector, resolution: 16}}\nmappo: {actor: {encoder: nature}}",
                {"run.yaml:3:26: mappo.actor.encoder: 'nature' needs images of at least 36 x 36 pixels, and "
                 "environment.observation.resolution is 16; allowed with it: impala, compact"}),
      in_config(
          "images alone for an encoder of numbers",
          "environment: {observation: {type: rgb}}\nmappo: {critic: {kind: state}}",
          {"run.yaml:1:11: scenario: agents of 'identical_2_vs_2' are given images alone (observation.type: rgb), "
           "and mappo.actor.encoder mlp reads numbers; nature, impala and compact read images"}),
      in_config(
          "encoder of images for the true state",
          "environment: {observation: {type: rgb}}\n"
          "mappo: {actor: {encoder: impala}, critic: {kind: state, encoder: impala}}",
          {"run.yaml:3:66: mappo.critic.encoder: 'impala' reads images, and mappo.critic.kind state the true state "
           "of the world, which is numbers; allowed with it: mlp"}),
      in_config("true state behind the actor's encoder", "mappo: {critic: {kind: state, shared_encoder: true}}",
                {"run.yaml:2:47: mappo.critic.shared_encoder: the actor's encoder reads what an agent is given, and "
                 "mappo.critic.kind state the true state of the world; allowed with it: false"}),
      in_config("two encoders for a critic",
                "environment: {observation: {type: rgb}}\n"
                "mappo: {actor: {encoder: compact}, critic: {shared_encoder: true, encoder: compact}}",
                {"run.yaml:3:76: mappo.critic.encoder: 'compact' would be an encoder of the critic's own, and "
                 "mappo.critic.shared_encoder: true gives it the actor's; allowed with it: mlp"}),
      in_config("normalised images",
                "environment: {observation: {type: rgb_vector}}\n"
                "mappo: {obs_norm: true, actor: {encoder: impala}}",
                {"run.yaml:3:19: mappo.obs_norm: this normalises the numbers that actors read, and mappo.actor.encoder "
                 "impala reads images; allowed with it: false"}),
      in_config("a view taught to an encoder of numbers", "mappo: {view_coef: 5}",
                {"run.yaml:2:20: mappo.view_coef: 5: this teaches an encoder of images, and mappo.actor.encoder mlp "
                 "reads numbers; allowed with it: 0"}),
      in_evolution("encoder of images in an evolution strategy",
                   "train: {algorithm: snes}\npopulation: {actor: {encoder: impala}}",
                   {"run.yaml:3:31: population.actor.encoder: 'impala' is not offered to populations, whose networks "
                    "read numbers; allowed there: mlp; train.algorithm mappo has it"}),
      in_config("memory without steps to learn it from", "mappo: {horizon: 1, actor: {memory: gru}}",
                {"run.yaml:2:37: mappo.actor.memory: 'gru' learns from the steps of a rollout in a row, and "
                 "mappo.horizon is 1; allowed with it: none; with memory mappo.horizon is at least 2"}),
      in_config("minibatches of parts of worlds, with memory",
                "train: {n_worlds: 10}\nmappo: {n_minibatches: 4, actor: {memory: lstm}}",
                {"run.yaml:3:24: mappo.n_minibatches: 4 does not divide train.n_worlds = 10, whose rollouts stay whole "
                 "with memory; nearest: 2, 5"}),
      in_evolution("memory in half precision",
                   "train: {algorithm: snes, precision: fp16}\npopulation: {actor: {memory: gru}}",
                   {"run.yaml:2:37: train.precision: fp16 is computed by one kernel, which knows no memory, and "
                    "population.actor.memory is gru; allowed there: fp32, tf32, bf16"}),
      {"checkpoint of another observation",
       "train: {opponent: ./other}",
       kTrain,
       {{"run.yaml", cat(kGame, "train: {opponent: ./other}\n")},
        {"other.yaml", cat(kGame, kShortest,
                           "environment: {observation: {type: rgb, resolution: 12}}\n"
                           "mappo: {horizon: 2, n_minibatches: 1, actor: {encoder: compact, hidden: [4]}, "
                           "critic: {kind: state, hidden: [4]}}\n")}},
       {"run.yaml:2:19: train.opponent: other was trained in 'identical_2_vs_2', with other settings; what differs: "
        "observation.type: rgb there, vector here",
        "an agent observes images of 12 x 12 pixels there, no images here"},
       kTrainOther},
      {"checkpoint of numbers where there are images",
       "gigastep eval other --vs circle --set environment.observation.type=rgb",
       {"eval", "other", "--vs", "circle", "--set", "environment.observation.type=rgb"},
       {{"other.yaml", cat(kGame, kShortest, "mappo: {horizon: 2, n_minibatches: 1}\n")}},
       {"other reads numbers, and agents of 'identical_2_vs_2' are given images alone (observation.type: rgb); what "
        "differs: observation.type: vector there, rgb here"},
       kTrainOther},
      in_config("number with a suffix", "train: {n_worlds: 4k}",
                {"run.yaml:2:19: train.n_worlds: '4k' is not an integer in [1, ", " (numbers have no suffix: 4000)"}),
      in_config("horizon longer than an episode", "environment: {max_episode_length: 20}\nmappo: {horizon: 32}",
                {"run.yaml:3:18: mappo.horizon: 32 is longer than an episode of scenario 'identical_2_vs_2'"}),
      {"run folder that holds something",
       "gigastep train run.yaml --run-dir old",
       {"train", "run.yaml", "--run-dir", "old", "--set", "train.total_agent_steps=1"},
       {{"old/notes.txt", "mine"}, {"run.yaml", kGame}},
       {"the run folder old is there already and not empty: a run is never overwritten; it holds no run"}},
      on_command_line("run folder that is not there", "gigastep resume runs/x", {"resume", "runs/x"},
                      {"there is no checkpoint or run folder runs/x"}),
      {"folder that is no run",
       "gigastep resume old",
       {"resume", "old"},
       {{"old/notes.txt", "mine"}},
       {"old is not a run folder: it has no config.yaml"}},
      {"run without a checkpoint",
       "gigastep resume old",
       {"resume", "old"},
       {{"old/config.yaml", kGame}},
       {"the folder old holds no checkpoint (checkpoints/update_NNNNNNNN.h5)"}},
      {"file that is no checkpoint",
       "gigastep inspect notes.h5",
       {"inspect", "notes.h5"},
       {{"notes.h5", "mine"}},
       {"notes.h5: is not a gigastep checkpoint"}},
      on_command_line("checkpoint to export that is not there",
                      "gigastep export runs/x --team 0 --format onnx --out new",
                      {"export", "runs/x", "--team", "0", "--format", "onnx", "--out", "new"},
                      {"there is no checkpoint or run folder runs/x"}),
      {"run to rate without a checkpoint",
       "gigastep rate old",
       {"rate", "old"},
       {{"old/notes.txt", "mine"}},
       {"the folder old holds no whole checkpoint (checkpoints/update_NNNNNNNN.h5)"}},
      {"exported policy without its manifest",
       "gigastep eval policy.safetensors --vs circle",
       {"eval", "policy.safetensors", "--vs", "circle"},
       {{"policy.safetensors", "mine"}},
       {"policy.safetensors has no manifest.json beside it"}},
      {"exported policy with a damaged manifest",
       "gigastep rate duellist",
       {"rate", "duellist"},
       {{"duellist/manifest.json", "{\"kind\": \"gigastep plicy\"}"}},
       {"duellist/manifest.json:1:10: kind: ", "is not one of: gigastep policy", "format_version: is missing"}},
      {"ONNX graph as a player",
       "gigastep eval policy.onnx --vs circle",
       {"eval", "policy.onnx", "--vs", "circle"},
       {{"policy.onnx", "mine"}},
       {"policy.onnx is an ONNX graph, which gigastep writes but does not read"}},
      {"TorchScript module without --trust",
       "gigastep rate module.pt",
       {"rate", "module.pt"},
       {{"module.pt", "mine"}},
       {"module.pt is a TorchScript module, which is code: opening it runs what is in it, with your rights; add "
        "--trust"}},
      {"several, in several files",
       "seed: -1\nenvironment: {limt_x: 3, team_1: []}\ntrain: {n_worlds: 10} with --set device=tpu and, in the "
       "scenario, rules: orignal",
       train_with_set("device=tpu"),
       {{"run.yaml",
         "scenario: ./game.yaml\nseed: -1\nenvironment: {limt_x: 3, team_1: []}\ntrain: {n_worlds: 10}\n"
         "mappo: {horizon: 5}\n"},
        {"game.yaml", "base: identical_2_vs_2\nrules: orignal\n"}},
       {"run.yaml:2:7: seed: '-1' is not an integer", "run.yaml:3:15: environment.limt_x: unknown key",
        "run.yaml:3:34: team_1: the team is empty", "game.yaml:2:8: rules: 'orignal' is not one of",
        "--set device: 'tpu' is not auto", "default of mappo.n_minibatches: 8 does not divide"}},
  };
}

std::vector<BadInput> all_bad_inputs() {
  std::vector<BadInput> all = form_of_files();
  for (const std::vector<BadInput>& more : {values(), meanings()}) all.insert(all.end(), more.begin(), more.end());
  return all;
}

/// Runs the program on an input; the message without the program's name.
std::string message_of(const BadInput& input) {
  const Workplace here;
  std::vector<std::string> given;
  for (const auto& [name, text] : input.files) {
    here.write(name, text);
    given.push_back(name.substr(0, name.find('/')));
  }
  if (!input.first.empty()) {
    const Outcome made = here.run(input.first);
    EXPECT_EQ(made.code, 0) << made.err;
    given.emplace_back("other");
    std::sort(given.begin(), given.end());
  }
  const Outcome outcome = here.run(input.arguments);
  EXPECT_EQ(outcome.code, 2) << input.kind << ": " << outcome.err;
  EXPECT_EQ(outcome.out, "") << input.kind;
  EXPECT_EQ(here.entries(), given) << input.kind << ": something was created";
  const std::string name = "gigastep: ";
  EXPECT_TRUE(outcome.err.starts_with(name)) << outcome.err;
  // Where the folder of the test is says nothing.
  std::string message = outcome.err.substr(name.size());
  const std::string folder = std::filesystem::canonical(here.path()).string() + "/";
  for (size_t at; (at = message.find(folder)) != std::string::npos;) message.erase(at, folder.size());
  const std::string program = shell_word(kGigastep);  // as advice names it
  for (size_t at; (at = message.find(program)) != std::string::npos;) message.replace(at, program.size(), "gigastep");
  return message;
}

/// Lines as code in a cell of a table.
std::string cell(std::string text) {
  while (text.ends_with('\n')) text.pop_back();
  // Code that has a backtick in it stands between two.
  const bool has_tick = text.find('`') != std::string::npos;
  const std::string open = has_tick ? "`` " : "`", close = has_tick ? " ``" : "`";
  std::string result = open;
  for (const char c : text) result += c == '\n' ? close + "<br>" + open : c == '|' ? "\\|" : std::string(1, c);
  return result + close;
}

/// The beginning of what is long.
std::string shortened(const std::string& text) {
  constexpr size_t kLongest = 200;
  return text.size() > kLongest ? text.substr(0, 20) + "..." : text;
}

TEST(BadInput, EveryKindIsToldAndTheTableInTheDocsIsCurrent) {
  std::string page =
      "# What gigastep says to bad input\n\n"
      "One input of each kind and the whole message; exit code 2, and nothing is created. Where a line of a\n"
      "config is shown, it is line 2 of `run.yaml`, behind `scenario: identical_2_vs_2`; a line of a\n"
      "scenario is line 2 of `game.yaml`, behind `base: identical_2_vs_2`. This page is written by\n"
      "`scripts/docs` from a test.\n\n"
      "| kind | input | message |\n|---|---|---|\n";
  const std::string file = source_path("docs/bad_input.md");
  const bool writes = std::getenv("GIGASTEP_WRITE_DOCS") != nullptr;
  const std::string current = read_file(file);
  const std::vector<BadInput> inputs = all_bad_inputs();
  const size_t stride = writes ? 1 : static_cast<size_t>(thinned(8));
  for (size_t k = stride / 2; k < inputs.size(); k += stride) {
    const BadInput& input = inputs[k];
    const std::string message = message_of(input);
    for (const std::string& part : input.parts) EXPECT_TRUE(contains(message, {part})) << input.kind;
    const std::string row = "| " + input.kind + " | " + cell(shortened(input.shown)) + " | " + cell(message) + " |\n";
    EXPECT_TRUE(writes || contains(current, {row})) << "scripts/docs writes the page anew; not there: " << row;
    page += row;
  }
  if (writes) std::ofstream(file) << page;
  if (stride > 1) return;
  EXPECT_EQ(read_file(file), page) << "scripts/docs writes it anew";
}

}  // namespace
}  // namespace giga::test
