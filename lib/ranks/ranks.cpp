#include "ranks/ranks.hpp"

#include <ATen/ATen.h>
#include <ATen/core/grad_mode.h>

#include <cstring>

#include "core/error.hpp"

namespace giga {
namespace {

std::string bytes_of(const at::Tensor& tensor) {
  const at::Tensor host = tensor.detach().cpu().contiguous();
  return {static_cast<const char*>(host.const_data_ptr()), host.nbytes()};
}

/// A tensor on the host with the shape and type of `like`.
at::Tensor tensor_of(const std::string& bytes, const at::Tensor& like, int rank) {
  at::Tensor host = at::empty(like.sizes(), like.options().device(at::kCPU).requires_grad(false));
  GIGA_CHECK(bytes.size() == host.nbytes(), "rank ", rank, " sent ", bytes.size(), " bytes, not ", host.nbytes());
  std::memcpy(host.data_ptr(), bytes.data(), bytes.size());
  return host;
}

}  // namespace

void Ranks::all_reduce_sum(const at::Tensor& tensor) {
  at::NoGradGuard no_grad;
  const std::vector<std::string> all = gather(bytes_of(tensor));
  at::Tensor sum = tensor_of(all[0], tensor, 0);
  for (int rank = 1; rank < size_; ++rank) sum.add_(tensor_of(all[static_cast<size_t>(rank)], tensor, rank));
  tensor.copy_(sum);
}

std::vector<std::vector<at::Tensor>> Ranks::gather_tensors(const std::vector<at::Tensor>& mine) {
  at::NoGradGuard no_grad;
  std::string bytes;
  for (const at::Tensor& x : mine) bytes += bytes_of(x);
  const std::vector<std::string> words = gather(bytes);
  std::vector<std::vector<at::Tensor>> all;
  for (int rank = 0; rank < size_; ++rank) {
    const std::string& word = words[static_cast<size_t>(rank)];
    GIGA_CHECK(word.size() == bytes.size(), "rank ", rank, " sent ", word.size(), " bytes, not ", bytes.size());
    std::vector<at::Tensor>& tensors = all.emplace_back();
    size_t from = 0;
    for (const at::Tensor& x : mine) {
      tensors.push_back(tensor_of(word.substr(from, x.nbytes()), x, rank));
      from += x.nbytes();
    }
  }
  return all;
}

void Ranks::broadcast(const at::Tensor& tensor, int from) {
  at::NoGradGuard no_grad;
  tensor.copy_(tensor_of(broadcast(rank_ == from ? bytes_of(tensor) : "", from), tensor, from));
}

std::string Ranks::broadcast(const std::string& text, int from) {
  return gather(rank_ == from ? text : "").at(static_cast<size_t>(from));
}

}  // namespace giga
