#include "learn/rank_sums.hpp"

#include <ATen/ATen.h>

#include <vector>

#include "core/error.hpp"
#include "ranks/divided_arrays.hpp"
#include "rollout/stream.hpp"
#include "rollout/tensors.hpp"

namespace giga {

RankSums::RankSums(Ranks& ranks, Device device) : ranks_(ranks), device_(device) {
  if (!device.is_cuda()) return;
  try {
    connect();
  } catch (...) {
    stop_watching();
    throw;
  }
}

RankSums::~RankSums() { stop_watching(); }

void RankSums::connect() {
  const std::string id = ranks_.broadcast(ranks_.leads() ? make_gpu_sum_id() : "");
  begin();
  gpus_ = make_gpu_sum(id, ranks_.rank(), ranks_.size(), device_.index);
  watched_gpus_ = gpus_.get();
  // The first sum makes connections.
  const at::Tensor x = at::ones({1}, at::TensorOptions().device(torch_device(device_)));
  add(x, nullptr);
  const auto size = x.item<float>();
  end();
  GIGA_CHECK(size == static_cast<float>(ranks_.size()), "a sum of ones over ", ranks_.size(), " ranks is ", size);
}

SumOverRanks RankSums::over_all() {
  return {[this](const at::Tensor& x, void* stream) { add(x, stream); }};
}

void RankSums::add(const at::Tensor& x, void* stream) {
  if (!gpus_) return ranks_.all_reduce_sum(x);
  GIGA_CHECK(x.is_cuda() && x.is_contiguous(), "a sum over GPUs of a tensor elsewhere, or with gaps");
  ++begun_;
  if (!stream) stream = current_stream(device_);
  try {
    if (x.scalar_type() == at::kDouble)
      gpus_->add(x.data_ptr<double>(), x.numel(), stream);
    else
      gpus_->add(x.data_ptr<float>(), x.numel(), stream);
  } catch (const Error&) {
    end();  // knows why, where a rank was missing
    throw;
  }
}

void RankSums::add_host(const at::Tensor& x) {
  if (!gpus_) return add(x, nullptr);
  const at::Tensor there = x.to(torch_device(device_));
  add(there, nullptr);
  x.copy_(there);
}

at::Tensor RankSums::gather(const at::Tensor& mine) {
  if (!gpus_) {
    std::vector<at::Tensor> all;
    for (const std::vector<at::Tensor>& of_rank : ranks_.gather_tensors({mine})) all.push_back(of_rank[0]);
    return at::cat(all).to(mine.device());
  }
  GIGA_CHECK(mine.is_cuda() && mine.is_contiguous() && mine.dim() == 1, "a tensor elsewhere, or with gaps");
  at::Tensor all = at::empty({ranks_.size() * mine.size(0)}, mine.options());
  ++begun_;
  try {
    gpus_->gather(static_cast<const uint8_t*>(mine.const_data_ptr()), static_cast<uint8_t*>(all.data_ptr()),
                  static_cast<int64_t>(mine.nbytes()), current_stream(device_));
  } catch (const Error&) {
    end();  // knows why, where a rank was missing
    throw;
  }
  return all;
}

void RankSums::gather_rows(NamedArray& array) {
  if (!gpus_) return giga::gather_rows(ranks_, array);
  const auto n = static_cast<int64_t>(array.bytes.size());
  begin();
  const at::Tensor all = gather(at::from_blob(array.bytes.data(), {n}, at::kByte).to(torch_device(device_)));
  array.bytes.resize(static_cast<size_t>(all.numel()));
  at::from_blob(array.bytes.data(), {all.numel()}, at::kByte).copy_(all);
  end();
  array.shape.at(0) *= ranks_.size();
}

void RankSums::begin() {
  if (!device_.is_cuda()) return;
  const auto begun = [this] {
    GpuSum* const gpus = watched_gpus_;
    if (const std::string trouble = gpus ? gpus->trouble() : ""; !trouble.empty()) throw Error(trouble);
    return begun_.load();
  };
  const auto give_up = [this] {
    if (GpuSum* const gpus = watched_gpus_) gpus->abort();
  };
  watched_ = true;
  ranks_.begin_outside({begun, give_up});
}

void RankSums::end() {
  if (!watched_) return;
  watched_ = false;
  ranks_.end_outside();
}

/// After a failure, of which something else tells.
void RankSums::stop_watching() noexcept {
  try {
    end();
  } catch (const Error&) {
  }
}

}  // namespace giga
