// Whom the members of a population meet: the other team's mean, its past means, and scripts.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <string>
#include <vector>

#include "core/named_array.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// The networks of a team that others may meet: its mean in row 0, then a ring of past means.
class MeanPool {
 public:
  /// `mean` [P]: the first of all.
  MeanPool(int64_t capacity, const at::Tensor& mean);

  /// Takes the team's new mean [P] into row 0.
  void set_mean(const at::Tensor& mean);
  /// Keeps the mean of row 0 as a past one, in the place of the oldest where the pool is full.
  void keep();
  int64_t size() const { return std::min(kept_, capacity()); }  ///< past means
  const at::Tensor& networks() const { return networks_; }      // [1 + capacity, P]

  /// The past means; after loading, row 0 is to be set.
  void save(const std::string& prefix, NamedArrays& out) const;
  void load(const std::string& prefix, const NamedArrays& in);

 private:
  int64_t capacity() const { return networks_.size(0) - 1; }

  at::Tensor networks_;
  int64_t kept_ = 0;  // since the start
};

/// What an assignment of opponents depends on besides the configuration.
struct AssignmentKey {
  uint64_t seed = 0;
  uint32_t generation = 0;
  int team = 0;  ///< that evolves
};

/// The opponent of each of `n_episodes` episodes: a row of the other team's MeanPool of `pool_size` past means, or a
/// script. First the scripts' share, in turn; then that of the pool, drawn uniformly; the rest meets the mean. Shares
/// are rounded to whole episodes.
std::vector<int32_t> assign_opponents(const OpponentsConfig& config, int64_t n_episodes, int64_t pool_size,
                                      const AssignmentKey& key);

}  // namespace giga
