// How a network takes a block of rows forward and back on a CPU.
#pragma once

#include <vector>

#include "policy/cpu_block.hpp"

namespace giga {

/// A network on observations.
class ObservationPass {
 public:
  explicit ObservationPass(const FusedMlp& net);

  /// The output [rows, width of the output] of the network with these parameters.
  Rows forward(const float* parameters, const FusedRows& rows, const Block& block);
  /// After forward: adds the gradient by the parameters to `gradient` [net.size], from that by the output, which is
  /// lost.
  void backward(const Block& block, Matrix& d_output, float* gradient);

 private:
  Eigen::Map<const Matrix> weight(int offset, int k) const {
    return {parameters_ + offset, net_.width[k + 1], net_.width[k]};
  }
  Eigen::Map<Matrix> place(float* at, int k) const { return {at, net_.width[k + 1], net_.width[k]}; }
  Eigen::Map<const Vector> bias(int k) const { return {parameters_ + net_.bias[k], net_.width[k + 1]}; }
  void gather(const FusedRows& rows, const Block& block);
  void exchange(const Block& block, int k, Rows& y);

  const FusedMlp net_;
  const float* parameters_ = nullptr;
  Matrix x_[FusedMlp::kLayers + 1];  // inputs of the layers, and the output
  Matrix slope_[FusedMlp::kLayers];  // of the activations
  Matrix mean_[FusedMlp::kLayers];   // [states, width] of what a layer reads; going back, its gradient
  Matrix team_[FusedMlp::kLayers];   // [states, width of the layer] what comes of the mean; going back, sums of states
  Matrix d_[FusedMlp::kLayers - 1];  // gradients by the inputs of the layers above the first
};

/// A critic of the true state (FusedState): the same two functions, for its value.
class StatePass {
 public:
  explicit StatePass(const FusedMlp& net);

  Rows forward(const float* parameters, const FusedRows& rows, const Block& block);
  void backward(const Block& block, Matrix& d_value, float* gradient);

 private:
  static constexpr int kOwn = 0, kOther = 1;
  int codes() const { return net_.width[1]; }
  int hidden() const { return net_.width[2]; }
  Eigen::Map<const Matrix> encoder() const { return {parameters_ + net_.weight[0], codes(), net_.width[0]}; }
  /// What the second layer reads: own code, mean codes of both teams, the world.
  int reads() const { return net_.state.inputs(codes()); }
  Eigen::Map<const Matrix> reader() const { return {parameters_ + net_.weight[1], hidden(), reads()}; }
  int first_of_mean(int team) const { return (1 + team) * codes(); }
  void gather(const FusedRows& rows, const Block& block);

  const FusedMlp net_;
  const float* parameters_ = nullptr;
  // The living of the other team, state by state, as Block has those of the own team.
  std::vector<int> other_begin_;
  std::vector<float> other_share_;
  Matrix agents_[2];       // [rows, 12] of the own team's rows; of the others'
  Matrix code_[2];         // [rows, codes]
  Matrix slope_[2];        // of these
  Matrix of_state_;        // [states, 2 codes + world] what its rows read alike
  Matrix mean_;            // [states, codes] of a team; going back, its gradient
  Matrix sums_;            // [states, hidden] what comes of it; going back, sums of states
  Matrix features_;        // [rows, hidden] of the second layer
  Matrix features_slope_;  // of these
  Matrix value_;           // [rows, 1]
  Matrix d_features_, d_code_[2];
};

}  // namespace giga
