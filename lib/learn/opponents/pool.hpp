// OpponentPool: the policies of a team that the other team may meet, its record against each, and whom it meets next.
#pragma once

#include <torch/types.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "core/named_array.hpp"
#include "learn/run_config.hpp"

namespace giga {

/// A policy is a row of numbers; row 0 is the team's present one, then comes a ring of past ones, then those from
/// elsewhere that stay (guests.hpp).
class OpponentPool {
 public:
  /// `present` [P]: the first of all; `guests` [G, P], or none.
  OpponentPool(int64_t capacity, const at::Tensor& present, const at::Tensor& guests = {});

  /// Takes the team's present policy [P] into row 0.
  void set_present(const at::Tensor& present);
  /// Keeps the policy of row 0 as a past one, in the place of the oldest where the pool is full. Results so far count
  /// half as much from now on. The row that it has now; 0 where the pool keeps none.
  int64_t keep();
  /// Results count half as much from now on; `keep` does so too.
  void fade();
  int64_t n_past() const { return std::min(kept_, capacity_); }
  int64_t n_guests() const { return networks_.size(0) - 1 - capacity_; }
  int64_t size() const { return n_past() + n_guests(); }  ///< policies besides the present one
  /// Whether there is a policy in a row other than 0.
  bool has(int64_t row) const;
  const at::Tensor& networks() const { return networks_; }  // [1 + capacity + guests, P]

  /// What the other team has won in `games` against a row; a tie is half a win. Row 0 has no record.
  void note(int64_t row, double games, double wins);
  /// The other team's win rate against a policy; half a win in one game is added, so that it is never 0 or 1.
  double win_rate(int64_t row) const;
  /// With what weight each policy is drawn: of rows 1 to the last that there is; 0 where there is none. Where all that
  /// there are would have 0, they are drawn alike. See PoolDraw.
  std::vector<double> weights(const OpponentsConfig& config) const;

  /// What a saved pool says of itself.
  struct Loaded {
    int64_t last_row;   ///< that it had room for
    bool other_guests;  ///< than there are now: these have no record yet
  };
  /// The past policies, the guests and the record; after loading, row 0 is to be set. `with_guests`: those that were
  /// saved, instead of the ones that there are.
  void save(const std::string& prefix, NamedArrays& out) const;
  Loaded load(const std::string& prefix, const NamedArrays& in, bool with_guests = false);

 private:
  at::Tensor guests() const { return networks_.narrow(0, 1 + capacity_, n_guests()); }
  int64_t place_of(int64_t kept) const { return kept % capacity_; }

  const int64_t capacity_;
  at::Tensor networks_;
  int64_t kept_ = 0;                  // since the start
  std::vector<double> games_, wins_;  // [capacity + guests] of rows 1 and up, older ones at less than they were
};

/// What draws of opponents depend on besides the weights.
struct PoolKey {
  uint64_t seed = 0;
  uint32_t update = 0;
  int team = 0;  ///< that meets them
};

/// Draw number `number`: a row from 1 to weights.size() in proportion to the weights, or with equal chances if all are
/// 0. Row 0 if there are no weights.
int32_t draw_opponent(const std::vector<double>& weights, const PoolKey& key, uint32_t number);

}  // namespace giga
