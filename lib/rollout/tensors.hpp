// Tensors over the project's own buffers, without a copy.
#pragma once

#include <torch/types.h>

#include "core/memory.hpp"
#include "sim/world_range.hpp"

namespace giga {

inline at::Device torch_device(Device device) {
  return device.is_cuda() ? at::Device(at::kCUDA, static_cast<at::DeviceIndex>(device.index)) : at::Device(at::kCPU);
}

template <class T>
at::ScalarType scalar_type_of() {
  if constexpr (std::is_same_v<T, float>) return at::kFloat;
  if constexpr (std::is_same_v<T, int32_t>) return at::kInt;
  if constexpr (std::is_same_v<T, uint8_t>) return at::kByte;
}

/// A view of `data` on `device`; whoever owns the data must outlive it.
template <class T>
at::Tensor wrap(const T* data, at::IntArrayRef shape, Device device) {
  const auto options = at::TensorOptions().dtype(scalar_type_of<T>()).device(torch_device(device));
  return at::from_blob(const_cast<T*>(data), shape, options);
}

/// The part of x [.., W, ..] in these worlds, which are its dimension `dim`: a view [.., shards, worlds of each, ..].
inline at::Tensor in_shards(const at::Tensor& x, const ShardRange& worlds, int64_t dim) {
  return x.unflatten(dim, {worlds.n_shards, worlds.shard_size})
      .narrow(dim + 1, worlds.in_shard.first, worlds.in_shard.count);
}

}  // namespace giga
