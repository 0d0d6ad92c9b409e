#include "policy/cpu_block.hpp"

namespace giga {

void choose(const FusedRows& rows, Who who, int most_states, int64_t& next, int64_t end, Block& block) {
  block.rows = block.states = 0;
  for (; next < end && block.states < most_states && block.rows + rows.n <= kBlockRows; ++next) {
    const int64_t state = rows.states ? rows.states[next] : next, first = state * rows.n;
    const uint8_t* alive = rows.alive + first;
    int living = 0;
    for (int i = 0; i < rows.n; ++i) living += alive[i] ? 1 : 0;
    if (who == Who::living && living == 0) continue;
    const float share = living > 0 ? 1.0f / static_cast<float>(living) : 0.0f;
    block.state[static_cast<size_t>(block.states)] = state;
    block.begin[static_cast<size_t>(block.states++)] = block.rows;
    for (int i = 0; i < rows.n; ++i) {
      if (who == Who::living && !alive[i]) continue;
      block.source[static_cast<size_t>(block.rows)] = first + i;
      block.share[static_cast<size_t>(block.rows++)] = alive[i] ? share : 0.0f;
    }
  }
  block.begin[static_cast<size_t>(block.states)] = block.rows;
}

void apply_activation(Activation activation, Rows y, Rows slope) {
  if (activation == Activation::tanh) {  // what Eigen computes eight at a time
    y.array() = y.array().tanh();
    slope.array() = 1.0f - y.array().square();
    return;
  }
  for (Eigen::Index r = 0; r < y.rows(); ++r)
    for (Eigen::Index c = 0; c < y.cols(); ++c) {
      const Activated a = activate_with_slope(activation, y(r, c));
      y(r, c) = a.value;
      slope(r, c) = a.slope;
    }
}

void mean_of_states(int states, const int* begin, const float* share, const Matrix& x, Matrix& mean) {
  for (int s = 0; s < states; ++s) {
    auto of_state = mean.row(s);
    of_state.setZero();
    for (int r = begin[s]; r < begin[s + 1]; ++r) of_state += share[r] * x.row(r);
  }
}

void share_with_rows(int states, const int* begin, const float* share, const Matrix& mean, Matrix& dx) {
  for (int s = 0; s < states; ++s)
    for (int r = begin[s]; r < begin[s + 1]; ++r) dx.row(r) += share[r] * mean.row(s);
}

void sum_of_states(int states, const int* begin, const Matrix& x, Matrix& sum) {
  for (int s = 0; s < states; ++s) sum.row(s) = x.middleRows(begin[s], begin[s + 1] - begin[s]).colwise().sum();
}

}  // namespace giga
