// SweepSpec: what a sweep tries, as its YAML file says it.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "config/duration.hpp"
#include "config/fields.hpp"

namespace giga {

/// A value of a key as YAML on one line: "0.99", "[64, 64]".
struct Choice {
  std::string yaml;
};
template <>
struct FieldCodec<Choice> {
  static bool read(const Node& node, Choice& value, const Allowed& allowed, const ReadSite& site);
  static std::string print(const Choice& value) { return value.yaml; }
  static std::string expected(const Allowed&) { return "a value"; }
  static ValueShape shape(const Allowed&) { return {ValueShape::Kind::text}; }
};

/// How many runs there are at once: a number, or `auto`, which is found by measuring (ParallelSearch).
struct RunsAtOnce {
  int number = 1;  ///< 0 = auto

  bool is_auto() const { return number == 0; }
  operator int() const { return number; }
};
template <>
struct FieldCodec<RunsAtOnce> {
  static bool read(const Node& node, RunsAtOnce& value, const Allowed& allowed, const ReadSite& site);
  static std::string print(const RunsAtOnce& value) { return value.is_auto() ? "auto" : std::to_string(value.number); }
  static std::string expected(const Allowed& allowed) { return FieldCodec<int>::expected(allowed) + " or auto"; }
  static ValueShape shape(const Allowed& allowed) {
    return {
        ValueShape::Kind::either, {}, {FieldCodec<int>::shape(allowed), {ValueShape::Kind::text, one_of({"auto"})}}};
  }
};

/// What values a key may take: exactly one of these is given.
struct ParameterSpec {
  std::vector<Choice> choices;
  std::optional<std::array<double, 2>> uniform, log_uniform;
  std::optional<std::array<int64_t, 2>> integers;
};
template <class V>
void visit_fields(V& v, ParameterSpec& c) {
  v("choices", c.choices, "these values");
  v("uniform", c.uniform, "a number between two, all alike");
  v("log_uniform", c.log_uniform, "a number between two, each order of magnitude alike", greater_than(0));
  v("integers", c.integers, "a whole number from the first to the second");
}

enum class SweepMethod : uint8_t { grid, random, sobol };
constexpr std::array<const char*, 3> enum_names(SweepMethod) { return {"grid", "random", "sobol"}; }

enum class SweepGoal : uint8_t { maximize, minimize };
constexpr std::array<const char*, 2> enum_names(SweepGoal) { return {"maximize", "minimize"}; }

/// Successive halving: all trials begin short, and the best of them go on.
struct HalvingSpec {
  std::optional<int64_t> first_agent_steps = std::nullopt;
  int factor = 3;
};
template <class V>
void visit_fields(V& v, HalvingSpec& c) {
  v("first_agent_steps", c.first_agent_steps,
    "agent-steps after which trials are compared for the first time; none = every trial is trained to its end",
    at_least(1));
  v("factor", c.factor, "one in so many goes on, for so many times the agent-steps", range(2, 100));
}

constexpr int kMostTrials = 100'000, kUsualTrials = 16;

struct SweepSpec {
  std::string config;
  std::vector<std::string> set;
  std::map<std::string, ParameterSpec> parameters;
  SweepMethod method = SweepMethod::sobol;
  std::optional<int> trials = std::nullopt;
  std::vector<uint64_t> seeds = {1};
  std::vector<std::string> metric;
  SweepGoal goal = SweepGoal::maximize;
  int last_values = 1;
  HalvingSpec halving;
  RunsAtOnce parallel;
  uint64_t seed = 0;
  std::optional<Duration> max_wall_time = std::nullopt;
};
template <class V>
void visit_fields(V& v, SweepSpec& c) {
  v("config", c.config, "the run config: a file, or the name of one that comes with gigastep");
  v("set", c.set, "what is changed in it for all trials, as KEY=VALUE");
  v.table("parameters", c.parameters, "what is tried: keys of the config, each with its values");
  v("method", c.method,
    "grid: every combination of choices and integers; random: drawn independently; sobol: drawn so that they fill the "
    "space evenly (Sobol 1967)");
  v("trials", c.trials,
    "how many settings are drawn, of which those that come out twice are tried once; of a grid, the first so many. "
    "none = 16; of a grid, all",
    range(1, kMostTrials));
  v("seeds", c.seeds, "each trial is trained once with each; its value is the mean", Allowed{}.items(1, 1000));
  v("metric", c.metric,
    "columns of metrics.csv by which trials are compared; of several the worst counts: the weaker team",
    Allowed{}.items(1, 64));
  v("goal", c.goal, "whether the metric should be large or small");
  v("last_values", c.last_values, "known values at the end of a column whose mean counts", range(1, 1000));
  v.group("halving", c.halving, "successive halving (ASHA, Li et al. 2020, arXiv 1810.05934)");
  v("parallel", c.parallel,
    "runs at once, each a process of its own; auto: one more while that makes at least 5 % more agent-steps per second",
    range(1, 1024));
  v("seed", c.seed, "of what is drawn");
  v("max_wall_time", c.max_wall_time, "save and stop after this time of one call; the next call goes on");
}

/// Trials of a sweep; of a grid at most as many as it has points.
int n_trials(const SweepSpec& spec);

/// Reads a file; throws InputError with all mistakes of the file itself: ranges that are empty, grids of numbers.
SweepSpec read_sweep(const std::filesystem::path& file, KeyPositions& given);

/// Throws InputError where halving would do nothing: its first stop does not lie before the end of a run of `total`
/// agent-steps.
void check_halving(const HalvingSpec& halving, int64_t total, const KeyPositions& given);

/// The agent-steps at which trials of runs of `total` agent-steps are compared, the last being `total`.
std::vector<int64_t> rungs_of(const HalvingSpec& halving, int64_t total);

}  // namespace giga
