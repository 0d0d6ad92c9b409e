// Blocks of rows, which the fused kernels' twins on a CPU (cpu_kernels.hpp) take through a network together.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstdint>

#include "cuda/ppo_gradients.hpp"

namespace giga {

/// Rows that go through a network together: what lies between its layers stays in the second cache.
constexpr int kBlockRows = 256;

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Rows = Eigen::Block<Matrix, Eigen::Dynamic, Eigen::Dynamic, true>;
using Vector = Eigen::RowVectorXf;

/// The agents of some states.
struct Block {
  int rows = 0, states = 0;
  std::array<int, kBlockRows + 1> begin;   // the first row of each state, and the end
  std::array<int64_t, kBlockRows> source;  // row of the rollout
  std::array<float, kBlockRows> share;     // of the mean of its state: 1 / living agents, 0 for the dead
  std::array<int64_t, kBlockRows> state;   // of the rollout, for each state
};

enum class Who : uint8_t { living, all };

/// States that a block may have: where a network reads the other team too, its rows have the same bound.
inline int most_states(const FusedMlp& net) { return kBlockRows / std::max(1, net.state.n_other); }
/// Fills a block with states from `next` on, and moves `next` behind them.
void choose(const FusedRows& rows, Who who, int most_states, int64_t& next, int64_t end, Block& block);

/// Numbers become features, and `slope` their derivatives.
void apply_activation(Activation activation, Rows y, Rows slope);

/// The first rows of a matrix, which becomes larger where it has too few.
inline Rows top(Matrix& m, int rows) { return m.topRows(rows); }
inline Rows top(Matrix& m, int rows, int columns) {
  if (m.rows() < rows || m.cols() != columns) m.resize(std::max(rows, kBlockRows), columns);
  return m.topRows(rows);
}

/// The first rows of `mean` = the sums of each state's rows of x, each times its share. `begin` [states + 1], `share`
/// [rows].
void mean_of_states(int states, const int* begin, const float* share, const Matrix& x, Matrix& mean);
/// The way back: each row of `dx` += its share of its state's row.
void share_with_rows(int states, const int* begin, const float* share, const Matrix& mean, Matrix& dx);
/// The first rows of `sum` = the sums of each state's rows of x.
void sum_of_states(int states, const int* begin, const Matrix& x, Matrix& sum);

}  // namespace giga
