// What all strategies share: the population, its noise, and saving.
#include "learn/evolution/strategy.hpp"

#include <algorithm>

#include "core/error.hpp"
#include "learn/evolution/fitness.hpp"

namespace giga {
namespace {

/// For each parameter the first of the numbers of its row of A (or of its column of B); -1 where it has its own.
std::pair<at::Tensor, at::Tensor> factor_places(const PopulationConfig& config, const PopulationPlace& place,
                                                int64_t n_parameters) {
  std::vector<int32_t> left(static_cast<size_t>(n_parameters), -1), right = left;
  int64_t next = 0;
  for (const MatrixPlace& m : place.matrices) {
    const int64_t a = next, b = next + m.rows * config.noise_rank;
    next = b + m.columns * config.noise_rank;
    for (int64_t i = 0; i < m.rows; ++i) {
      for (int64_t j = 0; j < m.columns; ++j) {
        const auto p = static_cast<size_t>(m.offset + i * m.columns + j);
        left.at(p) = static_cast<int32_t>(a + i * config.noise_rank);
        right.at(p) = static_cast<int32_t>(b + j * config.noise_rank);
      }
    }
  }
  return {at::tensor(left, at::kInt), at::tensor(right, at::kInt)};
}

}  // namespace

EvolutionStrategy::EvolutionStrategy(const PopulationConfig& config, const PopulationPlace& place,
                                     const at::Tensor& mean, const ParallelFor& parallel_for)
    : mean_(mean.detach().clone()),
      sigma_(at::full_like(mean_, config.sigma_init)),
      config_(config),
      seed_(place.seed),
      team_(place.team),
      share_(place.share),
      parallel_for_(parallel_for) {
  GIGA_CHECK(mean.dim() == 1 && mean.scalar_type() == at::kFloat, "a mean of ", mean.dim(), " dimensions");
  if (config.antithetic && config.population_size % 2 != 0)
    throw InputError(cat("population_size: ", config.population_size, " is odd; antithetic members come in pairs"));
  if (config.noise != EsNoiseKind::low_rank) return;
  std::tie(left_, right_) = factor_places(config, place, mean.size(0));
  left_ = left_.to(mean.device());
  right_ = right_.to(mean.device());
}

EsNoise EvolutionStrategy::noise() const {
  const bool low = left_.defined();
  return {seed_,
          generation_,
          static_cast<uint32_t>(team_),
          config_.antithetic ? 1 : 0,
          low ? config_.noise_rank : 0,
          low ? left_.const_data_ptr<int32_t>() : nullptr,
          low ? right_.const_data_ptr<int32_t>() : nullptr,
          mean_.size(0)};
}

at::Tensor EvolutionStrategy::ask() {
  const int64_t own = population_size() / share_.size;
  at::Tensor members = at::empty({own, mean_.size(0)}, mean_.options());
  parallel_for_.run(PerturbMembers{noise(), share_.rank * own, mean_.const_data_ptr<float>(),
                                   sigma_.const_data_ptr<float>(), members.data_ptr<float>()},
                    members.numel());
  if (config_.shaping.weight_decay > 0) mean_squares_ = members.square().mean(1);
  return members;
}

at::Tensor EvolutionStrategy::tell(const at::Tensor& fitness) {
  at::NoGradGuard no_grad;
  GIGA_CHECK(fitness.dim() == 1 && fitness.size(0) == population_size(), "fitness of ", fitness.numel(),
             " members, the population has ", population_size());
  at::Tensor shaped = shape_fitness(fitness.to(mean_.options()), config_.shaping.kind);
  if (mean_squares_.defined()) shaped = shaped - config_.shaping.weight_decay * of_all_ranks(mean_squares_);
  const std::vector<StateTensor> now = state();  // the same memory before and after
  std::vector<at::Tensor> before;
  for (const StateTensor& s : now) before.push_back(s.tensor.clone());
  learn(shaped);
  ++generation_;
  at::Tensor sound = at::ones({}, mean_.options().dtype(at::kBool));
  for (const StateTensor& s : now) sound = sound.logical_and(at::isfinite(s.tensor).all());
  for (size_t k = 0; k < now.size(); ++k) now[k].tensor.copy_(at::where(sound, now[k].tensor, before[k]));
  return sound;
}

EvolutionStrategy::Moments EvolutionStrategy::moments(const at::Tensor& weights) {
  const at::Tensor w = weights.contiguous();
  const int64_t p = mean_.size(0), n_parts = NoiseMoments::parts(population_size());
  const int64_t most = (p + share_.size - 1) / share_.size;  // parameters of a rank
  const int64_t first = std::min(share_.rank * most, p), own = std::min(most, p - first);
  const at::Tensor parts = at::empty({2, n_parts, own}, mean_.options()), sums = at::zeros({2, most}, mean_.options());
  parallel_for_.run(NoiseMoments{noise(), first, own, w.const_data_ptr<float>(), population_size(),
                                 parts[0].data_ptr<float>(), parts[1].data_ptr<float>()},
                    n_parts * own);
  for (int64_t k = 0; k < 2; ++k)
    parallel_for_.run(SumOfParts{n_parts, own, parts[k].const_data_ptr<float>(), sums[k].data_ptr<float>()}, own);
  const at::Tensor all = of_all_ranks(sums.flatten()).view({share_.size, 2, most});
  if (share_.size > 1) sums_ = all;
  return {all.select(1, 0).reshape({-1}).narrow(0, 0, p), all.select(1, 1).reshape({-1}).narrow(0, 0, p)};
}

std::vector<int> EvolutionStrategy::faulty_ranks() const {
  std::vector<int> ranks;
  for (int rank = 0; sums_.defined() && rank < share_.size; ++rank)
    if (!at::isfinite(sums_[rank]).all().item<bool>()) ranks.push_back(rank);
  return ranks;
}

void EvolutionStrategy::save(const std::string& prefix, NamedArrays& out) const {
  for (const StateTensor& s : state()) out.push_back(to_array(prefix + s.name, s.tensor));
  out.push_back(make_array<int64_t>(prefix + "generation", {static_cast<int64_t>(generation_)}));
}

void EvolutionStrategy::load(const std::string& prefix, const NamedArrays& in) {
  for (const StateTensor& s : state()) from_array(find_array(in, prefix + s.name), s.tensor);
  generation_ = static_cast<uint32_t>(array_values<int64_t>(find_array(in, prefix + "generation")).at(0));
}

}  // namespace giga
