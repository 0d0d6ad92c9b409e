// Algorithm: what the program knows about a learning algorithm, without LibTorch. All of them: registry.hpp.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/memory.hpp"

namespace giga {

class ConfigCheck;
class Learner;
class Ranks;
struct ActorConfig;
struct LoadedRun;
struct RunConfig;

/// The policies of a run.
struct PolicySettings {
  const ActorConfig& actor;
  bool greedy = false;    ///< they take their most likely action
  bool obs_norm = false;  ///< they normalise observations
  bool fused = true;      ///< on a GPU, fused kernels compute their actions where they serve
};

/// The setting that makes a run larger or smaller: worlds, or members of a population.
struct RunSize {
  std::string key, unit;           ///< "train.n_worlds", "world"
  int64_t value = 0;               ///< in the run's config
  int64_t step = 1;                ///< allowed are multiples of this ...
  int64_t smallest = 1, most = 1;  ///< ... in this range
};

/// Images that an update draws again instead of keeping them: bytes that they would take, and those of what is kept.
struct RedrawnImages {
  int64_t images = 0, kept = 0;
};

/// A chart in the report of a run: of the columns STEM_0 and STEM_1, or of the column STEM.
struct ChartRow {
  const char *stem, *title, *note;  ///< the note says unit and meaning
};

struct Algorithm {
  const char* name;      ///< the value of train.algorithm
  const char* about;     ///< one line
  const char* figures;   ///< its columns of metrics.csv, lines for --help
  const char* updates;   ///< what its updates are called: "updates", "generations"
  bool has_populations;  ///< each team is a population of networks
  /// Settings of a run that mean nothing to it: keys, or prefixes that end in a dot.
  std::span<const std::string_view> unread;
  std::span<const ChartRow> charts;  ///< of its figures; others get a chart without words

  PolicySettings (*policy)(const RunConfig&);
  int64_t (*agent_steps_per_update)(const RunConfig&, int n_agents);  ///< null: known only afterwards
  void (*check)(ConfigCheck&);  ///< mistakes that show only in the combination of keys and with the scenario
  /// Throws InputError where a run cannot be shared by so many ranks (lib/ranks).
  void (*expect_divides)(const RunConfig&, int n_ranks);
  /// "KEY=VALUE" of a setting that must not keep its default for that; empty where it has not; null: there is none.
  std::string (*setting_for_ranks)(const RunConfig&, int n_ranks) = nullptr;

  // For the memory plan.
  RunSize (*size)(const RunConfig&);
  void (*set_size)(RunConfig&, int64_t);
  void (*shorten)(RunConfig&);                           ///< makes an update quick without changing its memory
  int64_t (*least_bytes)(const LoadedRun&);              ///< of its largest buffers, whose size is exact: a lower bound
  RedrawnImages (*redrawn)(const LoadedRun&) = nullptr;  ///< null: it learns from no images
};

/// What a resumed run may do to a setting.
struct ResumeRule {
  std::string_view key;   ///< itself, or a prefix that ends in a dot
  std::string_view text;  ///< may change: what the change does; may not: the reason
};
struct ResumeRules {
  std::span<const ResumeRule> may_change, may_not;
};

/// The groups of settings of all algorithms, by type. Each has `visit_fields` and a static `resume_rules()`.
template <class... Groups>
struct SettingsOf : Groups... {
  static std::vector<ResumeRules> resume_rules() { return {Groups::resume_rules()...}; }
};
template <class V, class... Groups>
void visit_groups(V& v, SettingsOf<Groups...>& c) {
  (visit_fields(v, static_cast<Groups&>(c)), ...);
}

/// Adds the settings of the rows to `Found`; rows that share them add them once.
template <class Found, class... Rows>
struct CollectSettings {
  using Type = Found;
};
template <class... Found, class Row, class... Rest>
struct CollectSettings<SettingsOf<Found...>, Row, Rest...>
    : CollectSettings<std::conditional_t<(std::is_same_v<Found, typename Row::Settings> || ...), SettingsOf<Found...>,
                                         SettingsOf<Found..., typename Row::Settings>>,
                      Rest...> {};

/// A row is a type with its `Settings`, its `kAlgorithm`, and `make`, which makes the learner and needs LibTorch.
template <class... Rows>
struct AlgorithmList {
  using Settings = typename CollectSettings<SettingsOf<>, Rows...>::Type;
  using Make = std::unique_ptr<Learner> (*)(const LoadedRun&, Device, Ranks*);

  static std::vector<const Algorithm*> descriptions() { return {&Rows::kAlgorithm...}; }
  /// In the same order. Only callers of this need the learners at link time.
  static std::vector<Make> makers() { return {Rows::make...}; }
};

}  // namespace giga
