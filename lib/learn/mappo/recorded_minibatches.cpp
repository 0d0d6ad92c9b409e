#include "learn/mappo/recorded_minibatches.hpp"

#include <ATen/ATen.h>

namespace giga {

void RecordedMinibatches::learn(const at::Tensor& states, const at::Tensor& number, bool warm, const Learn& learn) {
  Minibatch& minibatch = by_size_[states.size(1)];
  if (!minibatch.states.defined()) {
    minibatch.states = at::empty(states.sizes(), states.options());
    minibatch.number = at::empty_like(number);
  }
  minibatch.states.copy_(states);
  minibatch.number.copy_(number);
  const auto queue = [&] { learn(minibatch.states, minibatch.number.const_data_ptr<float>()); };
  if (!minibatch.work && warm) minibatch.work = recorder_->record(queue);
  minibatch.work ? minibatch.work->queue() : queue();
}

}  // namespace giga
