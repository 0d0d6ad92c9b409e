#include "policy/sum_over_ranks.hpp"

#include <ATen/ATen.h>

#include <vector>

namespace giga {

void SumOverRanks::together(std::initializer_list<at::Tensor> tensors) const {
  if (alone()) return;
  std::vector<at::Tensor> flat;
  for (const at::Tensor& x : tensors)
    if (x.defined()) flat.push_back(x.reshape({-1}));
  const at::Tensor message = at::cat(flat);
  add(message, nullptr);
  int64_t from = 0;
  for (const at::Tensor& x : tensors) {
    if (!x.defined()) continue;
    x.copy_(message.narrow(0, from, x.numel()).view(x.sizes()));
    from += x.numel();
  }
}

}  // namespace giga
