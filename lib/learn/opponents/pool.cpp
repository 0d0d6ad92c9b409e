#include "learn/opponents/pool.hpp"

#include <cmath>
#include <numeric>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "policy/parameters.hpp"

namespace giga {

OpponentPool::OpponentPool(int64_t capacity, const at::Tensor& present)
    : networks_(at::zeros({1 + capacity, present.size(0)}, present.options())),
      games_(static_cast<size_t>(capacity)),
      wins_(static_cast<size_t>(capacity)) {
  set_present(present);
}

void OpponentPool::set_present(const at::Tensor& present) {
  at::NoGradGuard no_grad;
  networks_[0].copy_(present);
}

void OpponentPool::keep() {
  if (capacity() == 0) return;
  at::NoGradGuard no_grad;
  const int64_t place = place_of(kept_++);
  networks_[1 + place].copy_(networks_[0]);
  for (size_t k = 0; k < games_.size(); ++k) {
    games_[k] *= 0.5;
    wins_[k] *= 0.5;
  }
  games_[static_cast<size_t>(place)] = wins_[static_cast<size_t>(place)] = 0;
}

void OpponentPool::note(int64_t row, double games, double wins) {
  if (row == 0) return;
  GIGA_CHECK(row <= size(), "row ", row, " of ", size());
  games_[static_cast<size_t>(row - 1)] += games;
  wins_[static_cast<size_t>(row - 1)] += wins;
}

double OpponentPool::win_rate(int64_t row) const {
  const auto k = static_cast<size_t>(row - 1);
  return (wins_.at(k) + 0.5) / (games_.at(k) + 1);
}

std::vector<double> OpponentPool::weights(const OpponentsConfig& config) const {
  std::vector<double> weights(static_cast<size_t>(size()), 1.0);
  for (int64_t k = 0; k < size(); ++k) {
    double& weight = weights[static_cast<size_t>(k)];
    const int64_t age = place_of(kept_ - 1 - k);  // 0 = kept last
    if (config.pool_draw == PoolDraw::recency) weight = static_cast<double>(size() - age);
    if (config.pool_draw == PoolDraw::pfsp)
      weight = std::pow(1 - win_rate(k + 1), static_cast<double>(config.pool_hardness));
  }
  return weights;
}

void OpponentPool::save(const std::string& prefix, NamedArrays& out) const {
  if (capacity() == 0) return;
  out.push_back(to_array(prefix + "networks", networks_.narrow(0, 1, capacity())));
  out.push_back(make_array<int64_t>(prefix + "kept", {kept_}));
  out.push_back(make_array<double>(prefix + "games", games_));
  out.push_back(make_array<double>(prefix + "wins", wins_));
}

void OpponentPool::load(const std::string& prefix, const NamedArrays& in) {
  if (capacity() == 0) return;
  from_array(find_array(in, prefix + "networks"), networks_.narrow(0, 1, capacity()));
  kept_ = array_values<int64_t>(find_array(in, prefix + "kept")).at(0);
  if (kept_ < 0) throw InputError(cat("array '", prefix, "kept' holds ", kept_));
  const auto record = [&](const char* name, std::vector<double>& values) {
    std::vector<double> read = array_values<double>(find_array(in, prefix + name));
    if (read.size() != values.size())
      throw InputError(cat("array '", prefix, name, "' has ", read.size(), " numbers, expected ", values.size()));
    values = std::move(read);
  };
  record("games", games_);
  record("wins", wins_);
}

int32_t draw_opponent(const std::vector<double>& weights, const PoolKey& key, uint32_t number) {
  if (weights.empty()) return 0;
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  if (!(total > 0)) return draw_opponent(std::vector<double>(weights.size(), 1.0), key, number);
  DrawKey draws(key.seed, key.update, static_cast<uint32_t>(key.team));
  double left = static_cast<double>(draws.uniform(Draw::pool, 0, number)) * total;
  size_t k = 0;
  while (k + 1 < weights.size() && left >= weights[k]) left -= weights[k++];
  return static_cast<int32_t>(1 + k);
}

}  // namespace giga
