#include "learn/mappo/sequence_order.hpp"

#include <ATen/ATen.h>
#include <ATen/Context.h>

#include <mutex>
#include <vector>

#include "core/seeds.hpp"
#include "rollout/tensors.hpp"

namespace giga {
namespace {

/// A random order of 0 to n - 1. The generator is seeded afresh each time, so that it has no state to save.
at::Tensor random_order(int64_t n, uint64_t seed, Device where) {
  const at::Device device = torch_device(where);
  at::Generator generator = at::globalContext().defaultGenerator(device);
  {
    std::lock_guard lock(generator.mutex());
    generator.set_current_seed(seed);
  }
  return at::randperm(n, generator, at::TensorOptions().dtype(at::kLong).device(device));
}

}  // namespace

at::Tensor SequenceOrder::draw(uint64_t seed, Device device) const {
  if (n_shards == 1) return random_order(n_sequences, seed, device);
  const int64_t of_shard = n_worlds / n_own_shards;
  std::vector<at::Tensor> orders;  // [shards]: [minibatches, sequences]
  for (int64_t shard = 0; shard < n_own_shards; ++shard) {
    const uint64_t own = seed_of(seed, Purpose::permutation, static_cast<uint64_t>(first_shard + shard));
    const at::Tensor order = random_order(n_sequences / n_own_shards, own, device);
    const int64_t each = order.size(0) / n_minibatches;
    orders.push_back((order.div(of_shard, "floor") * n_worlds + order.remainder(of_shard) + shard * of_shard)
                         .slice(0, 0, n_minibatches * each)
                         .view({n_minibatches, each}));
  }
  return at::cat(orders, 1).flatten();
}

}  // namespace giga
