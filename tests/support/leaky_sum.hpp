// LeakySum: a small recurrent encoder to test memory with.
#pragma once

#include <torch/types.h>

#include "policy/encoder.hpp"

namespace giga::test {

/// h' = leak * h + x W^T. The features are h', and so is what is remembered.
class LeakySum final : public Encoder {
 public:
  static constexpr int64_t kFeatures = 5;

  LeakySum(ParameterSet& p, const std::string& name, int64_t input)
      : weight_(p.add(name + "/weight", {kFeatures, input}, {Init::Kind::orthogonal, 0.5f})),
        leak_(p.add(name + "/leak", {kFeatures}, {Init::Kind::constant, 0.7f})) {}

  at::Tensor forward(const ParameterSet& p, at::Tensor x, NetworkState& state, Rounding) const override {
    const at::Tensor sum = at::mm(x, p[weight_].t());
    state.rows = state.rows.defined() ? p[leak_] * state.rows + sum : sum;
    return state.rows;
  }
  at::Tensor forward_members(const ParameterSet& p, const at::Tensor& members, at::Tensor x, NetworkState& state,
                             Rounding) const override {
    const at::Tensor sum = at::bmm(x, p.of_members(members, weight_).transpose(1, 2));
    state.rows = state.rows.defined() ? p.of_members(members, leak_).unsqueeze(1) * state.rows + sum : sum;
    return state.rows;
  }
  int64_t features() const override { return kFeatures; }
  int64_t state_size() const override { return kFeatures; }

 private:
  int weight_, leak_;
};

inline std::shared_ptr<const Encoder> make_leaky_sum(ParameterSet& parameters, const std::string& name,
                                                     const ObservationShape& input, const NetworkConfig&) {
  return std::make_shared<LeakySum>(parameters, name, input.size());
}

}  // namespace giga::test
