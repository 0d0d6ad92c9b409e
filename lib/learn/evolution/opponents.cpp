#include "learn/evolution/opponents.hpp"

#include <algorithm>
#include <cmath>

#include "core/philox.hpp"
#include "math/population_actions.hpp"
#include "policy/parameters.hpp"

namespace giga {

MeanPool::MeanPool(int64_t capacity, const at::Tensor& mean)
    : networks_(at::zeros({1 + capacity, mean.size(0)}, mean.options())) {
  set_mean(mean);
}

void MeanPool::set_mean(const at::Tensor& mean) {
  at::NoGradGuard no_grad;
  networks_[0].copy_(mean);
}

void MeanPool::keep() {
  if (capacity() == 0) return;
  networks_[1 + kept_ % capacity()].copy_(networks_[0]);
  ++kept_;
}

void MeanPool::save(const std::string& prefix, NamedArrays& out) const {
  if (capacity() == 0) return;
  out.push_back(to_array(prefix + "networks", networks_.narrow(0, 1, capacity())));
  out.push_back(make_array<int64_t>(prefix + "kept", {kept_}));
}

void MeanPool::load(const std::string& prefix, const NamedArrays& in) {
  if (capacity() == 0) return;
  from_array(find_array(in, prefix + "networks"), networks_.narrow(0, 1, capacity()));
  kept_ = array_values<int64_t>(find_array(in, prefix + "kept")).at(0);
}

std::vector<int32_t> assign_opponents(const OpponentsConfig& config, int64_t n_episodes, int64_t pool_size,
                                      const AssignmentKey& key) {
  const auto share_of = [n_episodes](float share) {
    return static_cast<int64_t>(std::lround(static_cast<double>(share) * static_cast<double>(n_episodes)));
  };
  const int64_t scripted = config.scripted.empty() ? 0 : share_of(config.scripted_share);
  const int64_t pooled = pool_size > 0 ? std::min(share_of(config.pool_share), n_episodes - scripted) : 0;
  std::vector<int32_t> opponents(static_cast<size_t>(n_episodes), 0);
  DrawKey draws(key.seed, key.generation, static_cast<uint32_t>(key.team));
  for (int64_t e = 0; e < scripted + pooled; ++e) {
    int32_t& opponent = opponents[static_cast<size_t>(e)];
    if (e < scripted) {
      opponent = network_of_script(config.scripted[static_cast<size_t>(e) % config.scripted.size()]);
    } else {
      const float u = draws.uniform(Draw::pool, 0, static_cast<uint32_t>(e));
      opponent = 1 + static_cast<int32_t>(std::min<int64_t>(
                         static_cast<int64_t>(static_cast<double>(u) * static_cast<double>(pool_size)), pool_size - 1));
    }
  }
  return opponents;
}

}  // namespace giga
