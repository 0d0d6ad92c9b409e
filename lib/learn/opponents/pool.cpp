#include "learn/opponents/pool.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/error.hpp"
#include "core/philox.hpp"
#include "policy/parameters.hpp"

namespace giga {

OpponentPool::OpponentPool(int64_t capacity, const at::Tensor& present, const at::Tensor& from_elsewhere)
    : capacity_(capacity),
      networks_(at::zeros({1 + capacity + (from_elsewhere.defined() ? from_elsewhere.size(0) : 0), present.size(0)},
                          present.options())),
      games_(static_cast<size_t>(networks_.size(0) - 1)),
      wins_(games_.size()) {
  set_present(present);
  if (from_elsewhere.defined()) guests().copy_(from_elsewhere);
}

bool OpponentPool::has(int64_t row) const {
  return row >= 1 && row < networks_.size(0) && (row <= kept_ || row > capacity_);
}

void OpponentPool::set_present(const at::Tensor& present) {
  at::NoGradGuard no_grad;
  networks_[0].copy_(present);
}

int64_t OpponentPool::keep() {
  if (capacity_ == 0) return 0;
  at::NoGradGuard no_grad;
  const int64_t place = place_of(kept_++);
  networks_[1 + place].copy_(networks_[0]);
  fade();
  games_[static_cast<size_t>(place)] = wins_[static_cast<size_t>(place)] = 0;
  return 1 + place;
}

void OpponentPool::fade() {
  for (size_t k = 0; k < games_.size(); ++k) {
    games_[k] *= 0.5;
    wins_[k] *= 0.5;
  }
}

void OpponentPool::note(int64_t row, double games, double wins) {
  if (row == 0) return;
  GIGA_CHECK(has(row), "nobody is in row ", row);
  games_[static_cast<size_t>(row - 1)] += games;
  wins_[static_cast<size_t>(row - 1)] += wins;
}

double OpponentPool::win_rate(int64_t row) const {
  const auto k = static_cast<size_t>(row - 1);
  return (wins_.at(k) + 0.5) / (games_.at(k) + 1);
}

std::vector<double> OpponentPool::weights(const OpponentsConfig& config) const {
  const int64_t past = n_past();
  std::vector<double> weights(static_cast<size_t>(n_guests() > 0 ? capacity_ + n_guests() : past));
  double sum = 0;
  for (int64_t k = 0; k < static_cast<int64_t>(weights.size()); ++k) {
    if (!has(k + 1)) continue;
    const int64_t age = k < past ? place_of(kept_ - 1 - k) : 0;  // 0 = kept last, and guests
    double& weight = weights[static_cast<size_t>(k)];
    weight = 1;
    if (config.pool_draw == PoolDraw::recency) weight = static_cast<double>(std::max<int64_t>(past, 1) - age);
    if (config.pool_draw == PoolDraw::pfsp)
      weight = std::pow(1 - win_rate(k + 1), static_cast<double>(config.pool_hardness));
    sum += weight;
  }
  for (size_t k = 0; sum == 0 && k < weights.size(); ++k) weights[k] = has(static_cast<int64_t>(k) + 1) ? 1 : 0;
  return weights;
}

void OpponentPool::save(const std::string& prefix, NamedArrays& out) const {
  if (games_.empty()) return;
  out.push_back(to_array(prefix + "networks", networks_.narrow(0, 1, capacity_)));
  out.push_back(make_array<int64_t>(prefix + "kept", {kept_}));
  out.push_back(make_array<double>(prefix + "games", games_));
  out.push_back(make_array<double>(prefix + "wins", wins_));
  if (n_guests() > 0) out.push_back(to_array(prefix + "guests", guests()));
}

OpponentPool::Loaded OpponentPool::load(const std::string& prefix, const NamedArrays& in, bool with_guests) {
  if (games_.empty()) return {0, false};
  from_array(find_array(in, prefix + "networks"), networks_.narrow(0, 1, capacity_));
  kept_ = array_values<int64_t>(find_array(in, prefix + "kept")).at(0);
  if (kept_ < 0) throw InputError(cat("array '", prefix, "kept' holds ", kept_));
  const NamedArray* const saved = look_for_array(in, prefix + "guests");
  const int64_t n_saved = saved && !saved->shape.empty() ? saved->shape[0] : 0;
  const int64_t last_row = capacity_ + n_saved;
  const at::Tensor before = at::empty({n_saved, networks_.size(1)}, networks_.options());
  if (n_saved > 0) from_array(*saved, before);
  if (with_guests) {
    networks_ = at::cat({networks_.narrow(0, 0, 1 + capacity_), before});
    games_.resize(static_cast<size_t>(last_row));
    wins_.resize(games_.size());
  }
  const bool same = n_saved == n_guests() && at::equal(before, guests());
  const auto record = [&](const char* name, std::vector<double>& values) {
    const std::vector<double> read = array_values<double>(find_array(in, prefix + name));
    if (read.size() != static_cast<size_t>(last_row))
      throw InputError(cat("array '", prefix, name, "' has ", read.size(), " numbers, expected ", last_row));
    std::fill(values.begin(), values.end(), 0.0);
    std::copy_n(read.begin(), same ? last_row : capacity_, values.begin());
  };
  record("games", games_);
  record("wins", wins_);
  return {last_row, !same};
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
