// Parameters that are rounded all at once against each rounded by itself: the same numbers and gradients.
#include "policy/parameters.hpp"

#include <ATen/ATen.h>
#include <gtest/gtest.h>

namespace giga::test {
namespace {

ParameterSet set_of(int64_t rows) {
  ParameterSet p;
  p.add("a", {rows, 16}, {Init::Kind::orthogonal, 1});
  p.add("b", {rows}, {Init::Kind::constant, 0.3f});
  p.add("c", {3, rows}, {Init::Kind::orthogonal, 0.01f});
  p.add("unused", {3}, {Init::Kind::constant, 1});
  p.allocate(at::kCPU, 1);
  return p;
}

/// A sum that has another gradient by each number.
void backward(const ParameterSet& p) {
  at::Tensor sum = at::zeros({});
  for (int k = 0; k < 3; ++k) {
    const at::Tensor x = p[k].to(at::kBFloat16).flatten();
    sum = sum + (x * (at::arange(x.numel()).to(at::kBFloat16) / 7 - k)).to(at::kFloat).sum();
  }
  sum.backward();
}

TEST(PolicyParameters, RoundedAtOnceAsOneByOne) {
  for (const int64_t rows : {8, 5}) {  // of 5 the second matrix begins at number 85
    const ParameterSet one = set_of(rows), all = set_of(rows);
    const ParameterSet rounded = all.in_bfloat16();
    for (int k = 0; k < 4; ++k) {
      EXPECT_EQ(rounded[k].scalar_type(), at::kBFloat16) << k;
      if (rounded[k].numel() >= 8) {
        EXPECT_EQ(reinterpret_cast<uintptr_t>(rounded[k].data_ptr()) % 16, 0) << k;
      }
      EXPECT_TRUE(at::equal(rounded[k].to(at::kBFloat16), one[k].to(at::kBFloat16))) << k;
      EXPECT_TRUE(at::equal(rounded.exact(k), one[k])) << k;
    }
    backward(one);
    backward(rounded);
    EXPECT_TRUE(at::equal(all.gradient(), one.gradient()));
    EXPECT_GT(all.gradient().abs().max().item<float>(), 1);
    EXPECT_EQ(all.gradient().narrow(0, all.offset(3), 3).abs().max().item<float>(), 0);
    // What is learned is seen by what is rounded next, and gradients add up.
    all.values().fill_(2);
    EXPECT_EQ(all.in_bfloat16()[1].to(at::kFloat).min().item<float>(), 2);
    backward(all.in_bfloat16());
    EXPECT_TRUE(at::equal(all.gradient(), one.gradient() * 2));
  }
}

}  // namespace
}  // namespace giga::test
