#include "learn/memory/population.hpp"

#include <algorithm>
#include <optional>
#include <vector>

#include "core/error.hpp"
#include "cuda/population_policy.hpp"
#include "io/number.hpp"
#include "learn/evolution/opponents.hpp"
#include "learn/memory/items.hpp"
#include "learn/memory/network.hpp"
#include "learn/team_policy.hpp"
#include "math/es_noise.hpp"
#include "policy/actor.hpp"
#include "sim/state.hpp"

namespace giga {
namespace {

using Grows = PlanItems::Grows;

constexpr int64_t kHalf = 2;
/// Vectors [P] while a strategy learns: the old mean (twice) and sigma, both moments of the noise, and up to four on
/// the way to the new mean; before, sums over parts of the members beside five of these. To both come the old vectors
/// of an optimizer.
constexpr int64_t kLearningVectors = 9, kLearningVectorsBesideParts = 5;
/// Bytes by member that stay (the fitness, the mean square of the parameters, sums of the ranks' weights), and those
/// that ranking takes: sorted values, places and ranges of ranks in 64 bits.
constexpr int64_t kFitnessBytes = 16, kRankingBytes = 128;
constexpr int64_t kScalars = 4096;  // figures of a team, each in a block of its own

/// Bytes that come and go in a part of a generation, on top of the members.
struct Phase {
  const char* name;
  int64_t bytes;
  Grows grows;
};

/// The sizes of a run, and what they come to. M = members, P = parameters, E = worlds of a member.
class PopulationMemory {
 public:
  PopulationMemory(const LoadedRun& run, Device device);

  MemoryPlan plan();

 private:
  int64_t rows(int team) const { return m_ * e_ * n(team); }  // agents of the team in one population's worlds
  int64_t n(int team) const { return run_.spec.params.n_team[team]; }
  int64_t world_bytes() const;
  int64_t opponents() const { return self_play_ ? 1 + run_.config.opponents.pool_size : 1; }  // networks, with the mean
  int64_t vectors_of_strategy() const;
  int64_t learning_vectors() const {
    return std::max(kLearningVectors, kLearningVectorsBesideParts + 2 * NoiseMoments::parts(m_)) + optimizer_vectors();
  }
  int64_t optimizer_vectors() const { return run_.config.train.algorithm == "openai_es" ? 2 : 0; }
  int64_t forward(int64_t rows, int64_t members) const;
  int64_t play_opponents(int team) const;
  int64_t play() const;
  int64_t acting() const;
  Phase largest_phase() const;
  void add_games();
  void add_teams();
  int64_t slack(int64_t work, int64_t phase) const;

  const LoadedRun& run_;
  const Device device_;
  const PopulationConfig& config_;
  const bool self_play_;
  const int64_t m_, e_, d_, head_, p_;
  const int64_t populations_, teams_;  // that play at a time; that learn
  const int64_t element_;              // bytes of a feature
  const MemberNetworks networks_;
  const bool fused_;
  PlanItems items_;
};

std::optional<SmallMlp> small_mlp(const LoadedRun& run, Device device) {
  const ActorConfig& actor = actor_config(run.config);
  return Actor::small_mlp(actor, input_columns(actor.inputs, run.spec), run.spec.params.actions,
                          precision_on(run, device));
}

/// As PopulationGames has it.
MemberNetworks member_networks(const LoadedRun& run, Device device) {
  return precision_on(run, device) == Precision::fp16 ? MemberNetworks::fused : MemberNetworks::libtorch;
}

PopulationMemory::PopulationMemory(const LoadedRun& run, Device device)
    : run_(run),
      device_(device),
      config_(run.config.population),
      self_play_(run.config.train.opponent == Opponent::self_play),
      m_(config_.population_size),
      e_(config_.n_worlds()),
      d_(run.spec.padded_observation_size()),
      head_(Actor::head_size(run.spec.params.actions)),
      p_(Actor::count_parameters(actor_config(run.config), input_columns(actor_config(run.config).inputs, run.spec),
                                 run.spec.params.actions)),
      populations_(populations_at_a_time(run.config)),
      teams_(self_play_ ? kNTeams : 1),
      element_(precision_on(run, device) == Precision::bf16 ? 2 : kFloat),
      networks_(member_networks(run, device)),
      fused_(networks_ != MemberNetworks::libtorch),
      items_(run, device) {}

/// Observations and actions of a world.
int64_t PopulationMemory::world_bytes() const {
  const int64_t action = run_.spec.params.actions == ActionKind::discrete ? 1 : kActionSize;
  return kFloat * run_.spec.params.n_agents * (d_ + action);
}

/// Vectors [P] of a team: the actor's values and gradients, mean and sigma, and what the algorithm adds.
int64_t PopulationMemory::vectors_of_strategy() const {
  const int64_t places = config_.noise == EsNoiseKind::low_rank ? 2 : 0;  // int32
  return 4 + optimizer_vectors() + places;
}

/// Actor::forward_members (not in fp16), or Actor::forward where `members` is 0; observations are the caller's.
int64_t PopulationMemory::forward(int64_t rows, int64_t members) const {
  MemoryLedger m;
  if (element_ != kFloat) m.take(MemoryUse::actor, element_ * rows * d_);
  MlpMemory network(m, MemoryUse::actor, actor_config(run_.config), {d_, head_, rows, 0, element_, fused_});
  members > 0 ? network.infer_members(members) : network.infer();
  if (element_ != kFloat) m.take(MemoryUse::actor, kFloat * rows * head_);
  return sum(m.peak());
}

/// PopulationGames::move_opponents, where one network (the pool is empty) plays all episodes but those of scripts.
int64_t PopulationMemory::play_opponents(int team) const {
  const std::vector<int32_t> met = assign_opponents(run_.config.opponents, e_, {}, {});
  const auto by_network = std::count_if(met.begin(), met.end(), [](int32_t opponent) { return opponent >= 0; });
  const int64_t played = self_play_ ? rows(team) / e_ * by_network : 0;
  return kFloat * (rows(team) * head_ + played * d_) + (played > 0 ? forward(played, 1) : 0);
}

/// One population after the other, members and then opponents; the fused kernel needs nothing.
int64_t PopulationMemory::play() const {
  int64_t most = 0;
  for (int team = 0; team < kNTeams && !fused_; ++team)
    if (learns(run_.config.train, team)) most = std::max({most, forward(rows(team), m_), play_opponents(1 - team)});
  return most;
}

int64_t PopulationMemory::acting() const { return forward(run_.config.eval.episodes * std::max(n(0), n(1)), 0); }

Phase PopulationMemory::largest_phase() const {
  const int64_t squares = config_.shaping.weight_decay > 0 ? kFloat * m_ * p_ : 0;
  const int64_t members = kFloat * populations_ * m_ * p_;
  const Phase phases[] = {
      {"squares of a population", squares, Grows::yes},
      {"playing: activations", play(), Grows::yes},
      {"learning: vectors of the strategy", learning_vectors() * kFloat * p_,
       learning_vectors() > kLearningVectors + optimizer_vectors() ? Grows::yes : Grows::no},
      // They are summed in fp64, after a cast.
      {"results of the episodes", static_cast<int64_t>(sizeof(double)) * m_ * e_ * kNStatRows, Grows::yes},
      {"evaluation: activations", acting() - members, Grows::no},  // the members are gone by then
  };
  return *std::max_element(std::begin(phases), std::end(phases),
                           [](const Phase& a, const Phase& b) { return a.bytes < b.bytes; });
}

void PopulationMemory::add_games() {
  const int64_t worlds = populations_ * m_ * e_;
  items_.add_simulator(worlds);
  if (device_.is_cuda())
    items_.add("simulator: list of worlds", static_cast<int64_t>(sizeof(int32_t)) * (worlds + 1), Grows::yes,
               "those that still play");
  items_.add("observations, actions", world_bytes() * worlds, Grows::yes,
             cat(print_short(static_cast<double>(worlds)), " worlds, observations of ", d_, " numbers"));
}

void PopulationMemory::add_teams() {
  const std::string parameters = cat(print_short(static_cast<double>(p_)), " parameters");
  items_.add("strategies", teams_ * vectors_of_strategy() * kFloat * p_, Grows::no,
             cat(parameters, ": the policy, mean, sigma and what the algorithm adds"));
  items_.add("networks to play against", (teams_ * opponents() + 1) * kFloat * p_, Grows::no,
             cat("mean and opponents.pool_size ", run_.config.opponents.pool_size));
  items_.add("fitness", teams_ * (kFitnessBytes + kRankingBytes) * m_, Grows::yes, "and its ranks");
  items_.add("figures", teams_ * kScalars + populations_ * e_ * 12, Grows::no, "of a generation; who plays whom");
  items_.add("members", kFloat * populations_ * m_ * p_, Grows::yes,
             cat(populations_ == 1 ? "a population" : "both populations", " of ", parameters));
  if (!fused_) return;
  const int64_t packed = kHalf * PackedMlp(*small_mlp(run_, device_)).size;
  items_.add("members in half precision", populations_ * m_ * packed, Grows::yes, "for the fused kernel");
  items_.add("opponents in half precision", populations_ * opponents() * packed, Grows::no, "for the fused kernel");
}

/// Never falls as the population grows, which largest_size needs. Members have the same size in each generation and fit
/// into the place of those before; LibTorch keeps pieces of the rest. On the CPU the C library keeps up to as much as
/// comes and goes. Measured: 0.0 to 0.9 of it while the features of the narrowest layer are smaller than kHeapBlock,
/// 0.1 at twice that (5 against 5, 2 to 2,048 members, 4 and 64 episodes).
int64_t PopulationMemory::slack(int64_t work, int64_t phase) const {
  if (device_.is_cuda()) return static_cast<int64_t>(kCudaSlack * static_cast<double>(phase));
  const std::vector<int>& hidden = actor_config(run_.config).hidden;
  const int64_t block = kFloat * std::max(rows(0), rows(1)) * *std::min_element(hidden.begin(), hidden.end());
  const double kept = std::min(1.0, static_cast<double>(kHeapBlock) / static_cast<double>(block));
  return static_cast<int64_t>(kept * static_cast<double>(work));
}

MemoryPlan PopulationMemory::plan() {
  add_games();
  add_teams();
  const Phase phase = largest_phase();
  items_.add(phase.name, phase.bytes, phase.grows, "given back afterwards");

  const int64_t work = kFloat * populations_ * m_ * p_ + phase.bytes;
  // The policy without its gradients.
  const int64_t saved = teams_ * (vectors_of_strategy() - 1 + opponents()) * kFloat * p_;
  items_.add_rest({work, acting(), saved, slack(work, phase.bytes)});
  items_.set_networks(networks_);
  return items_.plan();
}

}  // namespace

MemoryPlan plan_population(const LoadedRun& run, Device device) {
  check_precision(run, device);
  return PopulationMemory(run, device).plan();
}

}  // namespace giga
